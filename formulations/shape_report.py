"""What `Shape.check` reports: disagreements among the functions of a shape."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Disagreement:
    """What disagrees, by how much, at which theta, and what to correct."""

    what: str
    got: str
    expected: str
    theta: tuple[float, ...]
    next: str

    def __str__(self) -> str:
        at = ", ".join(f"{t:.4g}" for t in self.theta)
        at = f", at theta ({at})" if at else ""
        return f"{self.what}: got {self.got}, expected {self.expected}{at}; {self.next}"


@dataclass(frozen=True)
class ShapeReport:
    """What `Shape.check` found: the first disagreement of each kind."""

    name: str
    found: tuple[Disagreement, ...]
    thetas: int

    @property
    def good(self) -> bool:
        """Whether nothing disagrees."""
        return not self.found

    def __str__(self) -> str:
        if self.good:
            return f"{self.name}: all functions agree at {self.thetas} theta"
        several = "" if len(self.found) == 1 else "s"
        head = f"{self.name}: {len(self.found)} disagreement{several}"
        return "\n".join([head, *map(str, self.found)])
