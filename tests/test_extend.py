"""Terms are added to a page, replaced and omitted without a copy of its `build`."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from formulations import quasi_static, violation_implicit
from formulations.balance import Balance
from tactilenlp import CUBOID, Options, extend, problem_of, solve_estimate
from tactilenlp.errors import OptionError, PageError

PAGE = "violation_implicit"

pytestmark = pytest.mark.usefixtures("not_compiled")


def cube(nlp, window, scene, shape):
    """Add a prior that all sides are the same."""
    sides = nlp.variables["theta"]
    nlp.minimize("cube", lambda s: ca.sumsqr(s - s[0]) / 2e-6, sides, role="prior")


def pull(nlp, window, scene, shape):
    """Add a term of the touches, wherever the fingers are."""
    touch = window.touch
    reach = lambda x, p: ca.sumsqr(x[:2] - p[:2])  # noqa: E731
    nlp.minimize(
        "pull", reach, nlp.variables["x"][:, touch.pose], touch.p_wf, role="prior"
    )


def square(lam, mu, w, rounding):
    """Return the room in a cone of four sides."""
    return (mu * lam[0] - ca.vertcat(lam[1], -lam[1], lam[2], -lam[2])) / w


class Light(Balance):
    """A balance in which nothing costs anything."""

    def unbalanced(self, *arguments):
        force, moment = super().unbalanced(*arguments)
        return 0 * force, 0 * moment


@pytest.fixture(scope="module")
def two(recorded):
    data, scene, _ = recorded
    return data.select([0, 1]), scene


def test_a_term_is_added_and_all_others_stay(two):
    base, more = problem_of(*two, PAGE), problem_of(*two, extend(PAGE, cube))
    assert [*more.costs] == [*base.costs, "cube"]
    assert [*more.constraints] == [*base.constraints]
    z, data = more.pack({"theta": np.array([[0.04], [0.05], [0.06]])}), more.data()
    assert more.value("cube", z, data) == pytest.approx((1e-2**2 + 2e-2**2) / 2e-6)
    assert max(more.check().derivatives["cube"]) < 1e-6


def test_constants_of_the_base_stay():
    page = extend(PAGE, cube)
    for name in ("LEVELS", "ROUGH", "FREED", "OFFSETS", "ALIKE"):
        assert getattr(page, name) is getattr(violation_implicit, name)
    assert page.__name__ == "violation_implicit + cube"
    assert not hasattr(extend(quasi_static, cube), "FREED")
    assert extend(PAGE, cube, shape="polytope").__name__.startswith("polytope_")


def test_a_term_is_replaced_in_all_its_instances(two):
    base = problem_of(*two, PAGE)
    page = extend(PAGE, replace={"finger cone": square}, without="ground cone")
    changed = problem_of(*two, page)
    term, was = changed.constraints["finger cone"], base.constraints["finger cone"]
    assert term.rows == 4 * was.rows
    assert (term.lower == 0).all()
    assert "ground cone" not in changed.constraints
    assert "ground cone" in base.constraints


def test_terms_of_one_name_are_replaced_by_the_part_before_the_comma(two):
    free = lambda *_: 0.0  # noqa: E731
    base = problem_of(*two, PAGE)
    balances = [n for n in base.costs if n.startswith("balance,")]
    assert balances
    for page in (extend(PAGE, replace={"balance": free}), extend(PAGE, law=Light)):
        changed = problem_of(*two, page)
        for name in balances:
            assert not changed.value(name, changed.pack({}), changed.data()).any()


@pytest.mark.parametrize("how", [{"replace": {"finger cone": square}},
                                 {"without": "finger cone"}])  # fmt: skip
def test_no_report_measures_a_cone_that_was_replaced_or_omitted(two, how):
    assert "finger cone, exact" in problem_of(*two, PAGE).reports
    changed = problem_of(*two, extend(PAGE, **how)).reports
    assert "finger cone, exact" not in changed
    assert "ground cone, exact" in changed

    def own(nlp, window, scene, shape):
        """Report the violation of a cone of four sides."""
        lam, outside = nlp.variables["finger"], lambda lam: -square(lam, 0.5, 1, 0)
        nlp.report("finger cone, exact", outside, lam)

    changed = problem_of(*two, extend(PAGE, own, **how))
    assert changed.reports["finger cone, exact"].function.rows == 4


def test_a_replaced_balance_is_not_said_to_give_way_as_that_of_the_page(two):
    names = problem_of(*two, "complementarity").reports.keys()
    page = extend("complementarity", replace={"balance": lambda *_: 0.0})
    left = problem_of(*two, page).reports.keys()
    responses = {name for name in names if name.endswith(", impulse response")}
    assert names - left == responses != set()


def test_added_terms_read_displaced_fingers(two):
    data, scene = two
    page = extend(PAGE, pull)
    problem = problem_of(data, replace(scene, sigma_offset=1e-3), page)
    offset = problem.variables["finger offset"]
    columns = np.arange(offset.span.start, offset.span.stop)
    assert np.isin(columns, problem.costs["pull"].unknowns).any()


def test_problems_do_not_share_functions_that_read_the_window(two):
    data, scene = two

    def samples(nlp, window, scene, shape):
        count = window.poses
        nlp.minimize("poses", lambda s: count + 0 * s[0], nlp.variables["theta"],
                     role="prior")  # fmt: skip

    page = extend(PAGE, samples)
    for given in (data, data.select([0])):
        problem = problem_of(given, scene, page)
        value = problem.value("poses", problem.pack({}), problem.data())
        assert value == problem.variables["x"].columns


def test_a_replacement_takes_the_arguments_of_the_term(two):
    page = extend(PAGE, replace={"finger cone": lambda mu, lam, rounding: lam[0]})
    with pytest.raises(
        PageError, match=r"cone_margin\(lam, mu, w, rounding\)"
    ) as refused:
        problem_of(*two, page)
    assert refused.value.got == "<lambda>(mu, lam, rounding)"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: extend(PAGE, 3), "give the function itself"),
        (lambda: extend(PAGE, replace=[cube]), "finger cone"),
        (lambda: extend(PAGE, replace={"finger cone": 3}), "give the function itself"),
        (lambda: extend(PAGE, balance=Light), "law"),
        (lambda: extend("viol", cube), "violation_implicit"),
        (lambda: extend(PAGE, cube, shape="cube"), "cuboid"),
        (lambda: extend(np, cube), "build"),
        (lambda: extend(PAGE, without=3), "names of terms"),
        (lambda: extend(PAGE, without=[[1]]), "names of terms"),
    ],
)  # fmt: skip
def test_what_cannot_extend_a_page_is_refused(make, words):
    with pytest.raises(OptionError, match=words):
        make()


@pytest.mark.parametrize("how", ["replace", "without"])
def test_a_term_that_the_page_does_not_state_is_refused(two, how):
    wrong = {"replace": {"finger cones": square}, "without": ("finger cones",)}[how]
    with pytest.raises(PageError, match="'finger cone', "):
        problem_of(*two, extend(PAGE, **{how: wrong}))


@pytest.mark.slow
def test_an_extended_page_is_solved(two):
    found = solve_estimate(
        *two, formulation=extend(PAGE, cube), options=Options(starts=1)
    )
    assert found.success
    assert found.costs["cube"] > 0
    assert np.ptp(found.side_lengths) < 2e-3
    assert found.formulation == "violation_implicit + cube"


@pytest.mark.slow
@pytest.mark.parametrize("order", [[0, 1, 2], [1, 0, 2]])
def test_a_prior_of_each_side_finds_the_body_under_the_names_that_it_means(
    recorded, order
):
    """The search takes the axes of a box as alike."""
    data, scene, truth = recorded
    sides = np.sort(truth["side_lengths"][:2])[::-1]
    told = np.r_[sides, truth["side_lengths"][2]][order]

    def catalogue(nlp, window, scene, shape):
        near = lambda s: ca.sumsqr(s - ca.DM(told)) / (2 * 0.3e-3**2)  # noqa: E731
        nlp.minimize("catalogue", near, nlp.variables["theta"], role="prior")

    found = solve_estimate(data, scene, formulation=extend(PAGE, catalogue))
    assert found.costs["catalogue"] < 1
    assert found.side_lengths == pytest.approx(told, abs=0.3e-3)


@pytest.mark.slow
def test_a_prior_of_each_side_of_a_box_may_name_the_shorter_one_first(recorded):
    data, scene, truth = recorded
    told = truth["side_lengths"][[1, 0, 2]]
    shape = replace(CUBOID, size_prior=(told, [0.3e-3] * 3))
    found = solve_estimate(data, scene, shape=shape)
    assert found.side_lengths == pytest.approx(told, abs=0.3e-3)
    assert found.costs["size prior"] < 1


def test_a_recursion_is_a_term_that_can_be_replaced_as_any(two):
    """What `follow` states is listed, and edited by its name."""
    page, stated = "multiple_shooting", []

    def still(theta, x_1, *others):
        stated.append(x_1)
        return x_1

    (name,) = (
        n for n in problem_of(*two, page).constraints if n.startswith("motion, 1")
    )
    problem_of(*two, extend(page, replace={name: still}))
    assert stated
