"""Sense touches with a camera behind a soft dome (DenseTact), as the paper does.

Under pressure the skin moves towards the camera and its texture expands: the
irrotational part of the flow since the reference is grad psi, with a minimum of psi at
the contact.  Therefore -psi is the pressure [px^2].  Its weighted mean is the centre of
pressure, its peak decides on contact, and the normal of the object is opposite to the
dome's there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tactilenlp.common.validation import check_kind, check_range, check_whole
from tactilenlp.errors import typed_call

from .errors import FrameError, RigError
from .hodge import Hodge
from .optical_flow import AGREE, Flow, grey, opencv
from .ranges import check_ranges, rotation
from .touch import DOWN, LONGEST_REST, Hysteresis, Touch

NARROWEST, WIDEST = 8.0, 10_000.0  # [px] of a lens in a picture
NODES = 80  # across the disc: sufficient for the decomposition, and fast
SURE = 0.7  # [1], least share of the disc where forward and backward flow agree: at
# least 0.9 with texture, 0.3 to 0.4 on a real gel without texture
HALF = 0.5  # [1], share of the peak pressure that bounds the region of a touch
ROUNDS, SETTLED = 20, 1e-3  # [1], [nodes] of the search for a centre of pressure
LEAST = 16.0  # [px^2], false peaks on real texture stay below it (256 px across)
ACROSS = 256.0  # [px], for which LEAST was measured; psi grows with the square
REST = 30  # [frames] without contact at first: one second


@typed_call(RigError)
@dataclass(frozen=True)
class Lens:
    """Map pixels to directions: an equidistant fish-eye at the centre of a sphere.

    centre: (u, v) [px] of the dome's axis in the picture, u to the right, v down
    edge:   [px] from there to the rim of the field of view
    angle:  [rad] of the rim from the axis, by default that of a DenseTact

    The sensor's frame: x along u, y along v, z out of the dome's top.  The radius of
    the dome is `tip_radius` of the finger.
    """

    centre: tuple[float, float]
    edge: float
    angle: float = math.radians(80)

    def __post_init__(self) -> None:
        check_ranges("Lens.centre", self.centre, 2, -WIDEST, WIDEST, "px", RigError)
        check_range("Lens.edge", self.edge, NARROWEST, WIDEST, "px", RigError)
        check_range("Lens.angle", self.angle, 1e-3, math.pi / 2, "rad", RigError)

    def direction(self, pixel: np.ndarray) -> np.ndarray:
        """Return the outward normals (..., 3) of the dome seen at pixels (..., 2)."""
        out = np.asarray(pixel, float) - self.centre
        polar = np.linalg.norm(out, axis=-1) * (self.angle / self.edge)
        around = np.arctan2(out[..., 1], out[..., 0])
        s = np.sin(polar)
        return np.stack([s * np.cos(around), s * np.sin(around), np.cos(polar)], -1)

    def pixel(self, direction: np.ndarray) -> np.ndarray:
        """Return where (..., 2) [px] the dome's normal (..., 3) is seen."""
        x, y, z = np.moveaxis(np.asarray(direction, float), -1, 0)
        distance = np.arctan2(np.hypot(x, y), z) * (self.edge / self.angle)
        around = np.arctan2(y, x)
        out = np.stack([distance * np.cos(around), distance * np.sin(around)], -1)
        return out + self.centre


@dataclass(frozen=True, eq=False)
class Sensed:
    """Hold the quantities measured in one picture, before the decision on contact.

    centre:   (u, v) [px], centre of pressure in the picture
    strength: [px^2], pressure there
    within:   whether it is highest within the field of view, not at its rim: there the
              skin may be pressed anywhere beyond, and the centre is not known
    agreement: [1], share of the disc where forward and backward flow agree
    pressure: (n, n) [px^2], -psi on the nodes of the disc
    """

    centre: np.ndarray
    strength: float
    within: bool
    agreement: float
    pressure: np.ndarray


@typed_call(RigError)
class OpticalTouch:
    """Make touches of pictures; the first second must be without contact.

    There are no touches of the next second: each of its pictures lets one of the first
    second be evaluated for the thresholds.  All at once would take as long, while the
    frames of the buses wait to be read.

    lens:   the nominal model of the sensor
    mount:  R_ts (3, 3), from the sensor's frame to the tip's
    rest:   pictures from which reference and thresholds are learnt

    `learn` does the same with given pictures.
    """

    def __init__(
        self,
        lens: Lens,
        mount: tuple = DOWN,
        rest: int = REST,
    ) -> None:
        check_kind("lens", lens, Lens, RigError)
        check_whole("rest", rest, 2, LONGEST_REST, RigError)
        self.lens, self.R_ts = lens, rotation("mount", mount, RigError)
        self.rest = rest
        self.decide: Hysteresis | None = None
        self._waiting: list[np.ndarray] = []
        self._strengths: list[float] = []
        self._flow: Flow | None = None
        half = math.ceil(lens.edge)
        self._corner = np.round(lens.centre).astype(int) - half
        self._spacing = math.ceil(2 * half / NODES)
        self._size = 2 * half // self._spacing * self._spacing
        nodes = np.indices((self._size // self._spacing,) * 2)[::-1]
        off = self._pixels(np.moveaxis(nodes, 0, -1)) - lens.centre
        self._hodge = Hodge((off**2).sum(axis=-1) <= lens.edge**2, self._spacing)
        self._within = ndimage.binary_erosion(self._hodge.mask)

    def __call__(self, time: float, frame: np.ndarray) -> Touch | None:
        """Return the touch, None while reference and thresholds are being learnt."""
        if self.decide is None:
            self._learn_from(self._cropped(frame))
            return None
        sensed = self.sense(frame)
        if sensed.agreement < SURE:
            return Touch(time, False, np.zeros(3), sensed.strength, valid=False)
        contact, normal = self.decide(sensed.strength), np.zeros(3)
        if contact and sensed.within:
            # Out of the object: opposite to the skin's outward normal.
            normal = -self.R_ts @ self.lens.direction(sensed.centre)
        return Touch(time, contact, normal, sensed.strength)

    def reset(self) -> None:
        """Learn reference and thresholds again, from the next pictures."""
        self.decide = self._flow = None
        self._waiting, self._strengths = [], []

    def learn(self, frames: Iterable[np.ndarray]) -> None:
        """Take the mean of pictures without contact as reference, learn thresholds."""
        self.reset()
        self._refer([self._cropped(frame) for frame in frames])
        while self.decide is None:
            self._evaluate_one()

    def sense(self, frame: np.ndarray) -> Sensed:
        """Return what is measured in a picture; raises FrameError before `learn`."""
        if self._flow is None:
            fix = "call learn with pictures without contact"
            raise FrameError("no reference yet", where="OpticalTouch", next=fix)
        return self._sensed(self._cropped(frame))

    def _sensed(self, cropped: np.ndarray) -> Sensed:
        flow, miss = self._flow(cropped)
        agree = self._coarse((miss < AGREE).astype(np.float32))[self._hodge.mask]
        pressure = -self._hodge.potential(self._coarse(flow))
        return Sensed(*self._centre(pressure), float(agree.mean()), pressure)

    def _learn_from(self, cropped: np.ndarray) -> None:
        """Take one more picture: a first one, or let one of these be evaluated."""
        if self._flow is not None:
            self._evaluate_one()
            return
        self._waiting.append(cropped)
        if len(self._waiting) >= self.rest:
            self._refer(self._waiting)

    def _refer(self, frames: list[np.ndarray]) -> None:
        """Make the reference of pictures, which wait to be evaluated."""
        if len(frames) < 2:
            raise FrameError(
                "nothing to learn", where="frames", got=len(frames),
                expected="two pictures without contact or more",
            )  # fmt: skip
        self._flow = Flow(np.mean(frames, axis=0).round().astype(np.uint8))
        self._waiting = frames

    def _evaluate_one(self) -> None:
        """Evaluate a picture without contact; learn the thresholds after the last."""
        self._strengths.append(self._sensed(self._waiting.pop()).strength)
        if not self._waiting:
            least = LEAST * (2 * self.lens.edge / ACROSS) ** 2
            self.decide = Hysteresis.learn(self._strengths, least)

    def _cropped(self, frame: np.ndarray) -> np.ndarray:
        """Return the square about the disc (size, size) uint8; raises FrameError."""
        picture = grey(frame)
        u, v = self._corner
        cut = picture[max(v, 0) : v + self._size, max(u, 0) : u + self._size]
        if u < 0 or v < 0 or cut.shape != (self._size, self._size):
            raise FrameError(
                "the disc is not in the picture",
                where="OpticalTouch",
                got=f"a picture {picture.shape[::-1]} px",
                expected=f"columns {u} to {u + self._size}, rows {v} to "
                f"{v + self._size}",
                next="set centre and edge of the lens for this camera",
            )
        return np.ascontiguousarray(cut)

    def _coarse(self, field: np.ndarray) -> np.ndarray:
        """Return the means of a field (size, size, ...) about the nodes."""
        n = self._size // self._spacing
        return opencv().resize(field, (n, n), interpolation=opencv().INTER_AREA)

    def _pixels(self, node: np.ndarray) -> np.ndarray:
        """Return where (..., 2) [px] nodes (..., 2) lie in the whole picture."""
        return (np.asarray(node) + 0.5) * self._spacing - 0.5 + self._corner

    def _centre(self, pressure: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Return the centre of pressure (u, v) [px], the pressure there, and `within`.

        A region that the rim truncates would have a mean too far inwards, by 5 degrees
        at 75: only nodes whose mirror image about the centre is on the disc count.
        """
        peak = np.unravel_index(pressure.argmax(), pressure.shape)
        strength = float(pressure[peak])
        if strength <= 0:  # no pressure
            return np.array(self.lens.centre, float), 0.0, True
        label, _ = ndimage.label(pressure >= HALF * strength)
        node = np.argwhere(label == label[peak])
        weight, centre = pressure[tuple(node.T)], np.array(peak, float)
        for _ in range(ROUNDS):
            both = self._on_disc(np.rint(2 * centre - node).astype(int))
            before, mass = centre, weight[both].sum()
            centre = weight[both] @ node[both] / mass if mass > 0 else centre
            if abs(centre - before).max() < SETTLED:
                break
        return self._pixels(centre[::-1]), strength, bool(self._within[peak])

    def _on_disc(self, node: np.ndarray) -> np.ndarray:
        """Return which nodes (n, 2), row and column, are on the disc (n,)."""
        size = len(self._hodge.mask)
        row, column = np.clip(node, 0, size - 1).T
        return self._hodge.mask[row, column] & (node >= 0).all(1) & (node < size).all(1)
