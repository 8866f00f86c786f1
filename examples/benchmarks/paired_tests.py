"""Statistics of trials, and of the same trials under two policies."""

import numpy as np
from scipy import stats


def mean_and_band(values: np.ndarray) -> tuple[float, float]:
    """Return the mean and half its 95 % band (normal distribution, as in the paper)."""
    n = len(values)
    if n < 2:
        return float(np.mean(values)), np.nan
    half = stats.t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n)
    return float(np.mean(values)), float(half)


def paired_in_words(x, y, many: int) -> str:
    """Return how errors x (n,) differ from y of the same trials [mm], with tests.

    many: p-values are multiplied by (Bonferroni).
    """
    free = stats.ttest_ind(x, y, equal_var=False)
    pair, signed = stats.ttest_rel(x, y), stats.wilcoxon(x, y)
    size = (y - x).mean() / np.std(y - x, ddof=1)
    low, high = pair.confidence_interval()
    variance = np.var(x, ddof=1) / np.var(y, ddof=1)
    return (
        f"difference {(x - y).mean():+.3f} [{low:+.3f}, {high:+.3f}] mm, "
        f"p = {min(1, many * free.pvalue):.2g} independent, "
        f"{min(1, many * pair.pvalue):.2g} paired, "
        f"{min(1, many * signed.pvalue):.2g} by Wilcoxon's test; effect size "
        f"{size:.2f}, variance ratio {variance:.2g}, better in "
        f"{(x < y).sum()} of {len(x)}"
    )
