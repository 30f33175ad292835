from unveil_core.api.frames import FrameView as FrameView
from unveil_core.api.objects import ObjectList as ObjectList
from unveil_core.api.objects import StreetObject as StreetObject
from unveil_core.api.scenes import Scene as Scene
from unveil_core.api.workspace import Workspace as Workspace
from unveil_core.api.workspace import run as run
from unveil_core.base.drive_options import DriveOptions as DriveOptions
from unveil_core.base.errors import UnveilError as UnveilError
from unveil_core.drives import open_drive as open_drive
from unveil_core.drives.drive import Drive as Drive
from unveil_core.geometry.camera import Camera as Camera
from unveil_core.pipeline.settings import RunSettings as RunSettings
from unveil_core.raster import render as render
from unveil_core.surfels.surfels import Surfels as Surfels

__version__: str
