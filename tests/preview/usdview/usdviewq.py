"""Replacement for pxr.Usdviewq, as documented by its plug-in tutorial and the help of its API.

    install()                       # before plug-ins are loaded
    usdview = Usdview(stage)        # a main window with one menu, a frame, a selection, a camera
    usdview.load_plugins()

usdview is part of full builds of OpenUSD only. These tests therefore cover our side: that Plug
finds the container, and that the container uses only documented functions.
"""

from __future__ import annotations

import sys
import types

from pxr import Gf, Plug, Sdf, Tf, Usd
from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QMainWindow


class PluginContainer:
    """Base of what plug-ins bring."""

    def registerPlugins(self, plugRegistry, usdviewApi):
        raise NotImplementedError

    def configureView(self, plugRegistry, plugUIBuilder):
        raise NotImplementedError


def install() -> None:
    """Put the package into place; `import pxr.Usdviewq.plugin` finds it then."""
    package, plugin = types.ModuleType("pxr.Usdviewq"), types.ModuleType("pxr.Usdviewq.plugin")
    package.__path__ = []
    PluginContainer.__module__ = plugin.__name__
    plugin.PluginContainer = PluginContainer
    package.plugin = plugin
    sys.modules |= {package.__name__: package, plugin.__name__: plugin}
    Tf.Type.Define(PluginContainer)


class Command:
    """What a registered command is to its menu."""

    def __init__(self, title, callback, description, api):
        self.displayName, self.description = title, description
        self.run = lambda: callback(api)


class Registry:
    """Where containers put their commands."""

    def __init__(self, api):
        self._api = api
        self.commands = {}

    def registerCommandPlugin(self, name, displayName, callback, description=""):
        assert name not in self.commands
        self.commands[name] = Command(displayName, callback, description, self._api)
        return self.commands[name]


class Menu:
    """A menu as plug-ins see it."""

    def __init__(self, menu):
        self._menu = menu

    def addItem(self, commandPlugin, shortcut=None):
        action = self._menu.addAction(commandPlugin.displayName, commandPlugin.run)
        action.setToolTip(commandPlugin.description)
        return action


class Builder:
    """What makes menus."""

    def __init__(self, window):
        self._window = window

    def findOrCreateMenu(self, menuName):
        return Menu(self._window.menuBar().addMenu(menuName))


class Selection(QObject):
    """dataModel.selection: paths, of which there is always one."""

    signalPrimSelectionChanged = Signal(set, set)

    def __init__(self, model):
        super().__init__()
        self._model = model
        self._paths = [Sdf.Path.absoluteRootPath]

    def getPrimPaths(self):
        return list(self._paths)

    def getPrims(self):
        return [self._model.stage.GetPrimAtPath(path) for path in self._paths]

    def setPrim(self, prim):
        self._become([prim.GetPath()])

    def addPrim(self, prim):
        self._become([*self._paths, prim.GetPath()])

    def clearPrims(self):
        self._become([])

    def _become(self, paths):
        before, self._paths = set(self._paths), paths or [Sdf.Path.absoluteRootPath]
        after = set(self._paths)
        self.signalPrimSelectionChanged.emit(after - before, before - after)


class DataModel(QObject):
    """usdviewApi.dataModel."""

    signalStageReplaced = Signal()
    signalPrimsChanged = Signal(object, object)

    def __init__(self, stage):
        super().__init__()
        self._stage = stage
        self.currentFrame = Usd.TimeCode.Default()
        self.playing = False
        self.selection = Selection(self)
        self.viewSettings = types.SimpleNamespace(cameraPrim=None)

    @property
    def stage(self):
        return self._stage

    @stage.setter
    def stage(self, stage):
        self._stage = stage
        self.viewSettings.cameraPrim = None
        self.signalStageReplaced.emit()


class Usdview:
    """A usdview, and as `api` what plug-ins are handed."""

    def __init__(self, stage):
        self.window = QMainWindow()
        self.window.menuBar().addMenu("File")
        self.model = DataModel(stage)
        self.status = []
        self.camera = Gf.Camera()
        self.api = Api(self)
        self.containers = []

    def load_plugins(self):
        """As usdview does at its start: find the types, load their modules, make and ask them."""
        base = Tf.Type.Find(PluginContainer)
        registry, builder = Registry(self.api), Builder(self.window)
        for kind in Plug.Registry.GetAllDerivedTypes(base):
            Plug.Registry().GetPluginForType(kind).Load()
            self.containers.append(kind.pythonClass())
        for container in self.containers:
            container.registerPlugins(registry, self.api)
        for container in self.containers:
            container.configureView(registry, builder)

    def menus(self):
        """What the menu bar holds: title -> action by name."""
        bar = self.window.menuBar().actions()
        return {of.text(): {item.text(): item for item in of.menu().actions()} for of in bar}


class Api:
    """usdviewApi."""

    def __init__(self, usdview):
        self._usdview = usdview

    dataModel = property(lambda self: self._usdview.model)
    stage = property(lambda self: self._usdview.model.stage)
    frame = property(lambda self: self._usdview.model.currentFrame)
    selectedPaths = property(lambda self: self._usdview.model.selection.getPrimPaths())
    cameraPrim = property(lambda self: self._usdview.model.viewSettings.cameraPrim)
    currentGfCamera = property(lambda self: Gf.Camera(self._usdview.camera))
    qMainWindow = property(lambda self: self._usdview.window)

    def PrintStatus(self, msg):
        self._usdview.status.append(msg)
