"""Where objects probably are, from sightings and from looks in vain.

The model is that of O'Neill ("Semantic Maps for Domestic Robots", 2015).
"""

from __future__ import annotations

from semmap.belief.error import BeliefError
from semmap.belief.inference import infer
from semmap.belief.observation_columns import Observations
from semmap.belief.sighting_model import SightingModel

__all__ = ["BeliefError", "Observations", "SightingModel", "infer"]
