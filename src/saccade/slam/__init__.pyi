"""The public names of `saccade.slam`, loaded when they are first used."""

from saccade.slam.config import EkfConfig as EkfConfig
from saccade.slam.consistency import Consistency as Consistency
from saccade.slam.filter.ekf import EkfSlam as EkfSlam
from saccade.slam.filter.predictions import Innovations as Innovations
from saccade.slam.filter.robot_models import compose as compose
from saccade.slam.filter.robot_models import difference as difference
from saccade.slam.filter.robot_models import inverse_observe as inverse_observe
from saccade.slam.filter.robot_models import observe as observe
from saccade.slam.filter.robot_models import turn_then_translate as turn_then_translate
from saccade.slam.filter.robot_models import wrap as wrap
from saccade.slam.filter.state import ERRORS as ERRORS
from saccade.slam.kidnapping import KidnappingDetector as KidnappingDetector
from saccade.slam.merging import MergedMaps as MergedMaps
from saccade.slam.merging import merge_maps as merge_maps
from saccade.slam.online import Slam as Slam
from saccade.slam.recorded_log import Recorder as Recorder
from saccade.slam.recorded_log import dead_reckon as dead_reckon
from saccade.slam.recorded_log import find_start as find_start
from saccade.slam.recorded_log import run as run
from saccade.slam.recorded_log import slam_for as slam_for
from saccade.slam.relocalization import Relocalizer as Relocalizer
from saccade.slam.results import PoseHypotheses as PoseHypotheses
from saccade.slam.results import SlamMap as SlamMap
from saccade.slam.results import SlamResult as SlamResult
from saccade.slam.results import StepResult as StepResult
from saccade.slam.smoothing import smooth as smooth
