"""Packages that only some parts need."""

from importlib import import_module


def need(package, install=None):
    """The module ``package``, or an error that says how to install it (``install``, by default its name)."""
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package.partition(".")[0]:
            raise
        words = f"quadverse: expected the package {error.name} (pip install {install or package}), found none"
        raise ModuleNotFoundError(words, name=error.name) from None
