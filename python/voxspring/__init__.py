"""Volumetric mass-spring-damper models on every API that this machine offers, and anybody's kernel judged beside them.

    import voxspring

    body = voxspring.scene("heart")
    simulation = voxspring.Simulation(body, backend="auto")
    simulation.step(1000)
    simulation.displacement         # numpy, (n, 3)

judge() verifies and times a function of your own; study() runs a study of the program. A wrong value raises BadInput, a
ValueError. A device or library that this machine lacks raises Unavailable, a RuntimeError. Messages read as in the program.
"""

from ._core import BadInput, Body, CardArray, DeviceError, Refused, Simulation, Unavailable
from .judging import Arrays, Judge, Wrong, judge
from .results import Result, scene, study

__all__ = ["Arrays", "BadInput", "Body", "CardArray", "DeviceError", "Judge", "Refused", "Result", "Simulation", "Unavailable",
           "Wrong", "judge", "scene", "study"]
