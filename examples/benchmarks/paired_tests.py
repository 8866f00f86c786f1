"""Statistics of trials, and of the same trials under two policies.

An estimate that failed is infinitely far.  It ranks as the worst in Wilcoxon's test and
in "better in"; t-tests, means and variances are of the pairs in which both are finite.
"""

import numpy as np
from scipy import stats

PRIMARY = (
    "Primary test: Wilcoxon's, surface distance after the last action, chosen (eig) "
    "against random.\nAll other p-values are secondary: multiplied by the number of "
    "actions (Bonferroni),\nnot by the numbers of tests, measures and policies."
)
FEWEST = 3  # pairs of finite errors for a t-test


def mean_and_band(values: np.ndarray) -> tuple[float, float]:
    """Return the mean and half its 95 % band (normal distribution, as in the paper).

    The mean of values that failed is infinite, and has no band.
    """
    n = len(values)
    if n < 2 or not np.isfinite(values).all():
        return float(np.mean(values)), np.nan
    half = stats.t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n)
    return float(np.mean(values)), float(half)


def paired_in_words(x, y, many: int) -> str:
    """Return how errors x (n,) differ from y of the same trials [mm], with tests.

    many: p-values are multiplied by (Bonferroni).
    """
    told = lambda p: f"{min(1, many * p):.2g}"  # noqa: E731
    words = (
        f"p = {told(wilcoxon(x, y))} by Wilcoxon's test, "
        f"better in {(x < y).sum()} of {len(x)}"
    )
    both = np.isfinite(x) & np.isfinite(y)
    if left_out := np.count_nonzero(~both):
        words += f"; t-tests leave out {left_out} pairs that failed"
    x, y = x[both], y[both]
    if len(x) < FEWEST:
        return words
    free, pair = stats.ttest_ind(x, y, equal_var=False), stats.ttest_rel(x, y)
    size = (y - x).mean() / np.std(y - x, ddof=1)
    low, high = pair.confidence_interval()
    variance = np.var(x, ddof=1) / np.var(y, ddof=1)
    return (
        f"{words}; difference {(x - y).mean():+.3f} [{low:+.3f}, {high:+.3f}] mm, "
        f"p = {told(free.pvalue)} independent, {told(pair.pvalue)} paired; effect size "
        f"{size:.2f}, variance ratio {variance:.2g}"
    )


def wilcoxon(x, y) -> float:
    """Return the two-tailed p-value of Wilcoxon's signed-rank test of x (n,) and y.

    Infinite differences have the largest ranks; where both are infinite there is none.
    """
    differ = x != y
    difference = np.subtract(x, y, where=differ, out=np.zeros(len(x)))
    return float(stats.wilcoxon(difference).pvalue) if differ.any() else 1.0
