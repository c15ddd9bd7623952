from usdsplat import formats as formats
from usdsplat import schema as schema
from usdsplat.cli.main import main as main
from usdsplat.core import edit as edit
from usdsplat.core.cloud import SplatCloud as SplatCloud
from usdsplat.core.errors import UsdSplatError as UsdSplatError
from usdsplat.delegate.engine import Engine as Engine
from usdsplat.images.deep_reader import DeepImage as DeepImage
from usdsplat.images.deep_reader import read_deep as read_deep
from usdsplat.interchange import ExportOptions as ExportOptions
from usdsplat.interchange import ImportOptions as ImportOptions
from usdsplat.interchange import SequenceOptions as SequenceOptions
from usdsplat.interchange import convert as convert
from usdsplat.interchange import export_capture as export_capture
from usdsplat.interchange import import_capture as import_capture
from usdsplat.interchange.lod import LodOptions as LodOptions
from usdsplat.interchange.lod import build_tree as build_tree
from usdsplat.interchange.procedural import capture as _capture
from usdsplat.kernels.devices import open_device as open_device
from usdsplat.preview.opening import StageLoading as StageLoading
from usdsplat.preview.opening import open_document as open_document
from usdsplat.preview.picking import pick as pick
from usdsplat.preview.saving import save_view as save_view
from usdsplat.preview.session import Session as Session
from usdsplat.preview.values import Opened as Opened
from usdsplat.preview.values import Picture as Picture
from usdsplat.preview.values import SimulationStatus as SimulationStatus
from usdsplat.preview.values import ViewState as ViewState
from usdsplat.products.drawing import draw_frames as draw_frames
from usdsplat.products.page import PageRequest as PageRequest
from usdsplat.products.page import write_page as write_page
from usdsplat.products.planning import plan_pictures as plan_pictures
from usdsplat.products.preparing import DrawOptions as DrawOptions
from usdsplat.products.request import RenderRequest as RenderRequest
from usdsplat.render.settings import RenderSettings as RenderSettings
from usdsplat.sim.stage.authoring import author as _author
from usdsplat.sim.stage.simulation import Simulation as Simulation

__version__: str
author_parameters = _author
procedural_capture = _capture
