"""Margins: how far objectives must differ before a choice depends on it [nats].

An objective is a negative log posterior density up to a constant, so that a difference
of d nats is odds of exp(d) to 1.  A margin with no odds in its comment was set by trial
on recordings: wide where problems are solved roughly, narrow where to the end.
"""

from __future__ import annotations

# Dropped if this far behind the best:
LEAST_MOTION_BEHIND = 15.0  # before a page with physics is solved
FAILED_BEHIND = 100.0  # after first levels that stopped early

# What an objective says of a solve:
UNCHANGED = 0.5  # more data that add less leave the optimum as it was
RESTORED = 1.0  # what a reduction dropped may add when it is restored
# What physics may cost each action, besides DOUBTFUL or DECISIVE: on the right poses
# of 119 clean boxes of 1 to 6 actions it costs 1.8 nats at most, of six of 20 actions
# 5.2; on the poses of the four that were lost 2.2 to 9.7.  Those actions have 13 steps
# at the mean, a longer one counts as several: on the right poses of six boxes of
# actions of 2 and 3 s, of 40 to 70 steps, it costs 2.4 to 4.9, once 12, on those of two
# that were lost 13 and 19.
PHYSICS_SHARE = 0.2
STEPS_OF_ACTION = 13
UPDATE_SHARE = 2.0  # [cost of an action so far] that an update may add per action

# Between solves to the end:
NEGLIGIBLE = 40.0  # behind the best optimum: of no weight beside it
# Odds of 20 to 1: what a face that no touch supports must gain, a freed assumption if
# its Occam factor is not computed, and an update beyond its share may cost; nearer
# optima are not decided by a solve of a simpler model; a motion between two actions
# that costs more, and a deviation that costs more, need another explanation.
DECISIVE = 3.0
DOUBTFUL = DECISIVE / 2  # what it takes to look again, where that is cheap

# Profile likelihood:
PROFILE_RISE = DECISIVE  # at which one ends; half of it for a pose: a rougher solve
ONE_SIGMA = 0.5  # of a Gaussian at one standard deviation
BETTER_OPTIMUM = 0.1  # by which another optimum is better
