"""First touch: sweep paths find an object of unknown position."""

import numpy as np
import pytest

from tactilenlp import Ground, Measurements, Options, Workspace, World, explore
from tactilenlp.errors import NoContactError, SceneError
from tactilenlp.exploration.sweep import AIM_HEIGHT, aim, sweep


def test_without_a_centre_the_workspace_is_swept_until_something_is_touched():
    world = World((0.05, 0.035, 0.04), position=(0.03, 0.0))
    few = Options(hypotheses=2, starts=3)
    given = {"options": few, "formulation": "quasi_static"}
    (step,) = explore(world, actions=0, **given)
    assert step.action is None
    assert len(step.told) > 1
    assert step.measurements.contact.any()
    assert step.estimate.measurements.actions == 1  # what met nothing is not counted


def test_an_empty_workspace_says_so():
    class Nothing:
        def execute(self, trajectory):
            n, F = 31, trajectory.finger_position.shape[1]
            self.time = getattr(self, "time", 0.0) + 2.0
            return Measurements(
                time=self.time + np.linspace(0, 1, n),
                finger_position=trajectory.finger_position[:: 100 // 30][:n],
                finger_radius=np.full(F, 0.01), contact=np.zeros((n, F), bool),
                normal=np.zeros((n, F, 3)), action=np.zeros(n, int),
            )  # fmt: skip

    with pytest.raises(NoContactError, match=r"centre=\(x, y\)"):
        next(explore(Nothing()))


def test_the_sweep_passes_within_a_finger_of_every_place():
    space = Workspace()
    p = np.concatenate([t.finger_position[:, 0] for t in sweep(space, np.zeros(3))])
    rng = np.random.default_rng(0)
    for place in rng.uniform(-0.1, 0.1, (200, 2)):
        nearest = np.linalg.norm(p[:, :2] - place, axis=1).min()
        assert nearest < space.finger_radius + 0.006  # of a box 12 mm wide


@pytest.mark.parametrize(
    "ground", [Ground(height=-0.4), Ground(0.3, (0.0, -np.sin(0.3), np.cos(0.3)))]
)
def test_a_first_touch_aims_at_a_place_on_the_ground_wherever_that_is(ground):
    point = aim(Workspace(ground=ground), (0.1, 0.2))
    assert point[:2] == pytest.approx((0.1, 0.2))
    assert ground.distance(point) == pytest.approx(AIM_HEIGHT)
    given = np.array([0.1, 0.2, 0.3])
    assert (aim(Workspace(ground=ground), given) == given).all()


def test_a_place_in_x_and_y_is_none_on_a_wall():
    with pytest.raises(SceneError, match="too steep"):
        aim(Workspace(ground=Ground(0.0, (1.0, 0.0, 0.0))), (0.1, 0.2))
