"""First touch: sweep paths find an object of unknown position."""

import numpy as np
import pytest

from tactilenlp import Ground, Measurements, Options, Scene, Workspace, World, explore
from tactilenlp.errors import NoContactError, SceneError
from tactilenlp.exploration.sweep import AIM_HEIGHT, aim, first_touch, sweep


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


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
@pytest.mark.parametrize("centre", [None, (0.02, 0.0, 0.02)])
def test_a_ground_of_any_height_carries_its_sweep_along(normal, centre):
    """Parked fingers included: in the ground's frame all sweeps are the same."""
    known, ways = 0.0 if centre is None else np.array(centre), []
    for height in (0.0, 0.4, -0.4):
        ground = Ground(height, normal)
        place = None if centre is None else known + ground.origin
        paths = sweep(Workspace(3, ground=ground), place)
        ways.append([ground.to_ground(path.finger_position) for path in paths])
    np.testing.assert_allclose(ways[1:], ways[:1] * 2, atol=1e-12)
    assert np.min(ways[0]) < 0.0 < np.min(np.array(ways[0])[..., 2])


def test_no_finger_is_parked_below_the_ground_or_lower_than_the_sweep():
    below = Ground(height=0.4), np.zeros(3)  # a centre that is not told in height
    for ground, centre in ((Ground(height=0.4), None), below):
        space = Workspace(3, ground=ground, clearance=0.2)
        for path in sweep(space, centre):
            height = ground.distance(path.finger_position)
            assert (height[:, 1:] >= height[:, :1]).all()


@pytest.mark.slow
def test_a_body_on_a_ground_far_above_the_origin_is_found_and_estimated():
    world, scene = World((0.05, 0.035, 0.04), ground=0.4), Scene(ground=Ground(0.4))
    given = {"options": Options(hypotheses=2, starts=3), "actions": 0}
    (step,) = explore(world, scene, formulation="quasi_static", **given)
    assert step.measurements.contact.any()
    assert step.estimate.position[-1, 2] == pytest.approx(0.42, abs=0.02)


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


def test_a_body_that_is_met_as_a_motion_ends_is_touched_in_the_next():
    """A contact in the last sample alone does not last: the next begins before it."""
    rng = np.random.default_rng(0)
    for x in (-0.0165, -0.0160, -0.0155):
        world = World((0.05, 0.035, 0.04), position=(x, 0.0))
        _, data, _ = first_touch(world, Workspace(), None, rng)
        assert data.contact.any()


def test_a_parked_finger_stands_in_no_obstacle():
    wall = (-0.3, -1.0, -1.0, -0.15, 1.0, 1.0)
    space = Workspace(obstacles=(wall,))
    assert space.action([0.0, 0.2, 0.0, 0.2], (True, False)).blocked((0, 0, 0.02))
    for trajectory in sweep(space):
        assert not space.blocked(trajectory.finger_position)
