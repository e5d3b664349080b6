from .clutch import Clutch as Clutch
from .link_client import LinkClient as LinkClient
from .plus_device_set import plus_device_set as plus_device_set
from .pose_track import PoseTrack as PoseTrack
from .recorded_hand import RecordedHand as RecordedHand
from .transform_repository import TransformRepository as TransformRepository
from .transform_repository import frames_of as frames_of
