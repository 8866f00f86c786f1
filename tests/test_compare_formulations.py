"""The comparison of formulations: one problem has one lowest objective."""

from conftest import benchmark

compared = benchmark("compare_formulations")


def found(page: str, nats: float) -> dict:
    row = {"scene": "made", "actions": 2, "page": page, "converged": True}
    return row | {"nats": nats}


def test_pages_with_other_levels_share_the_lowest_objective(compared):
    rows = [found("violation_implicit", 30.0), found("loose first", 10.0)]
    assert [row["best"] for row in compared.judged(rows)] == [False, True]
    rows = [found("shooting", 5.0), found("shooting, sharp", 9.0)]
    assert [row["best"] for row in compared.judged(rows)] == [True, False]


def test_objectives_of_different_problems_are_not_compared(compared):
    pages = ("violation_implicit", "shooting", "paper", "no dynamics")
    rows = [found(page, 10.0 * k) for k, page in enumerate(pages)]
    assert all(row["best"] for row in compared.judged(rows))
