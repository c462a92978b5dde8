"""A trained policy that is a small neural network, as numbers only: what trained it is not needed to follow it. Pure.

Layers of a multilayer perceptron, the last of which has a logit for each choice of each knob: down, none, up for delay, then for
drop, then for speed, as ``MultiDiscrete([3, 3, 3])`` orders them. The most likely choice is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.environment import OBSERVATION_SIZE
from simple_ros_engines.network_exposure.maximizer.knobs import KNOBS, Action

__all__ = ["ANY_TOPIC", "Layer", "Network", "NetworkPolicy"]

ANY_TOPIC = "*"
_CHOICES = 3
_MOST_UNITS = 4096


def _relu(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum(values, 0.0)


_ACTIVATIONS: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "tanh": np.tanh,
    "relu": _relu,
}


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """One layer: ``weights @ what came + biases``.

    Attributes:
        weights: A row for each unit.
        biases: One for each unit.
    """

    weights: NDArray[np.float64]
    biases: NDArray[np.float64]


class Network:
    """Layers with an activation between them.

    Args:
        layers: Weights and biases of each, as torch's ``Linear`` has them.
        activation: Between layers: tanh or relu.

    Raises:
        ConfigError: They do not fit each other, observations or actions, or are no finite numbers.
    """

    def __init__(
        self, layers: Sequence[tuple[ArrayLike, ArrayLike]], activation: str = "tanh"
    ) -> None:
        if activation not in _ACTIVATIONS:
            raise ConfigError(f"activation is tanh or relu, not {activation!r}")
        self.activation = activation
        self.layers = tuple(_layer(number, *one) for number, one in enumerate(layers))
        size = OBSERVATION_SIZE
        for number, layer in enumerate(self.layers):
            if layer.weights.shape[1] != size:
                raise ConfigError(
                    f"layer {number} takes {layer.weights.shape[1]} numbers, but {size} come"
                )
            size = len(layer.biases)
        if not self.layers or size != _CHOICES * len(KNOBS):
            raise ConfigError(f"the last layer must have {_CHOICES * len(KNOBS)} units, not {size}")

    def logits(self, observation: ArrayLike) -> NDArray[np.float64]:
        """A number for each choice of each knob."""
        values = np.asarray(observation, dtype=np.float64)
        activate = _ACTIVATIONS[self.activation]
        for layer in self.layers[:-1]:
            values = activate(layer.weights @ values + layer.biases)
        return self.layers[-1].weights @ values + self.layers[-1].biases

    def act(self, observation: ArrayLike) -> Action:
        """The most likely notch of each knob."""
        delay, drop, speed = self.logits(observation).reshape(len(KNOBS), _CHOICES).argmax(axis=1)
        return int(delay) - 1, int(drop) - 1, int(speed) - 1

    def as_numbers(self) -> dict[str, Any]:
        """What a file keeps of it."""
        layers = [
            {"weights": layer.weights.tolist(), "biases": layer.biases.tolist()}
            for layer in self.layers
        ]
        return {"activation": self.activation, "layers": layers}

    @classmethod
    def from_numbers(cls, read: Mapping[str, Any]) -> Network:
        """The network that a file describes.

        Raises:
            ConfigError: See the class.
            KeyError: A part is missing.
            TypeError: A part is of another kind.
        """
        return cls(
            [(one["weights"], one["biases"]) for one in read["layers"]], str(read["activation"])
        )


@dataclass(frozen=True, slots=True, eq=False)
class NetworkPolicy:
    """Networks by topic.

    Attributes:
        networks: By full name of a topic, by its last part, or `ANY_TOPIC`; looked for in this order.
        made_by: What trained them, for readers.
    """

    networks: Mapping[str, Network]
    made_by: str = ""

    def of(self, topic: str) -> Network | None:
        """The network of a topic; None if nothing was learnt for any like it."""
        name = topic.lstrip("/")
        for known in (name, name.rpartition("/")[2], ANY_TOPIC):
            if known in self.networks:
                return self.networks[known]
        return None


def _layer(number: int, weights: ArrayLike, biases: ArrayLike) -> Layer:
    try:
        layer = Layer(np.array(weights, dtype=np.float64), np.array(biases, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise ConfigError(f"layer {number} is not made of rows of numbers: {error}") from None
    rows, columns = (*layer.weights.shape, 0, 0)[:2]
    fits = layer.weights.ndim == 2 and layer.biases.shape == (rows,)
    if not fits or not 0 < rows <= _MOST_UNITS or not 0 < columns <= _MOST_UNITS:
        raise ConfigError(
            f"layer {number} has weights of shape {layer.weights.shape} and biases of shape "
            f"{layer.biases.shape}: they must be (n, m) and (n,), at most {_MOST_UNITS} each"
        )
    if not (np.isfinite(layer.weights).all() and np.isfinite(layer.biases).all()):
        raise ConfigError(f"layer {number} has numbers that are not finite")
    return layer
