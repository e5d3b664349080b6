from .clutch import Clutch as Clutch
from .pose_track import PoseTrack as PoseTrack
from .recorded_hand import RecordedHand as RecordedHand
from .transform_repository import TransformRepository as TransformRepository
from .transform_repository import frames_of as frames_of
