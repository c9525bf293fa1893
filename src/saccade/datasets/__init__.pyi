"""The public names of `saccade.datasets`, loaded when they are first used."""

from saccade.datasets import fixations as fixations
from saccade.datasets.drives.calibration import load_camera as load_camera
from saccade.datasets.drives.loading import DriveKind as DriveKind
from saccade.datasets.drives.loading import load_drive as load_drive
from saccade.datasets.drives.writing import save_drive as save_drive
from saccade.datasets.landmark_maps import load_map as load_map
from saccade.datasets.logs.conversions import OdometryNoise as OdometryNoise
from saccade.datasets.logs.loading import Kind as Kind
from saccade.datasets.logs.loading import load as load
from saccade.datasets.logs.loading import save as save
from saccade.datasets.tables import symmetric_columns as symmetric_columns
from saccade.datasets.tables import write_landmarks as write_landmarks
from saccade.datasets.tables import write_table as write_table
from saccade.datasets.tables import write_tum as write_tum
