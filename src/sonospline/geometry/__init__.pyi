from .grid import FACES as FACES
from .grid import Grid as Grid
from .grid import face_slice as face_slice
from .label_map import LabelMap as LabelMap
from .layered_block import layered_block as layered_block
from .needle import Needle as Needle
from .needle import Projection as Projection
from .plane import ImagePlane as ImagePlane
from .pose import facing as facing, rigid as rigid, to_image as to_image, to_reference as to_reference
from .tissue import Tissue as Tissue
from .volume import Volume as Volume
