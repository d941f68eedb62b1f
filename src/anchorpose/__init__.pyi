from anchorpose.api.arrays import DepthImages as DepthImages
from anchorpose.api.frame_by_frame import Pose as Pose
from anchorpose.api.frame_by_frame import Tracker as Tracker
from anchorpose.api.results import Results as Results
from anchorpose.api.track import open_results
from anchorpose.api.track import track as track
from anchorpose.camera import Camera as Camera
from anchorpose.errors import AnchorposeError as AnchorposeError
from anchorpose.errors import InputError as InputError
from anchorpose.joints import JOINT_NAMES as JOINT_NAMES
from anchorpose.joints import JointState as JointState
from anchorpose.lens import Intrinsics as Intrinsics
from anchorpose.recording.recording import Subject as Subject
from anchorpose.tracker.config import TrackConfig as TrackConfig

__version__: str
open = open_results
