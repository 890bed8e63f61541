"""A legged robot's simulator that agrees with the robot.

Everything is loaded when it is first used, so that ``import quadverse`` takes no time.
SI units, radians, seconds; z is up; quaternions are w, x, y, z.
"""

_HOME = {
    "Batch": "batch",
    "Parameters": "batch",
    "Snapshot": "_quadverse",
    "Recording": "recording",
    "open": "recording",
    "Replay": "report",
    "Report": "report",
    "diagnose": "report",
    "replay": "report",
    "Contact": "command",
    "Policy": "command",
    "QvError": "command",
    "Tuned": "command",
    "contact": "command",
    "qv": "command",
    "train_walk": "command",
    "tune": "command",
    "Cloud": "_quadverse",
    "cloud": "view",
    "open_cloud": "view",
    "render": "view",
    "VelocityTask": "_quadverse",
    "NavigationTask": "_quadverse",
    "VelocityEnv": "gym",
    "NavigationEnv": "gym",
    "__version__": "_quadverse",
}
#: Modules that are loaded when they are first named.
_MODULES = ("fleet",)

__all__ = [name for name in _HOME if name not in ("VelocityEnv", "NavigationEnv", "__version__")]


def __getattr__(name):
    from importlib import import_module

    if name in _MODULES:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"quadverse has no {name!r}; it has {', '.join(__dir__())}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted([*_HOME, *_MODULES])
