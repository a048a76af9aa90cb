"""Errors of the commands."""

from mhsb_model.errors import MhsbError


class VariationError(MhsbError):
    """The variations of a machine cannot be used."""


class ScenarioError(MhsbError):
    """The scenarios of a study cannot be used."""


class TuningError(MhsbError):
    """The servo cannot be tuned."""
