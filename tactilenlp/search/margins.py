"""Margins: how far objectives must differ before a choice depends on it [nats].

An objective is a negative log posterior density up to a constant, so that a difference
of d nats is odds of exp(d) to 1.  A margin with no odds in its comment was set by trial
on recordings: wide where problems are solved roughly, narrow where to the end.
"""

from __future__ import annotations

# Dropped if this far behind the best:
START_BEHIND = 60.0  # a start or a hypothesis, where problems are solved roughly
LEAST_MOTION_BEHIND = 15.0  # before a page with physics is solved
FAILED_BEHIND = 100.0  # after first levels that stopped early

# What an objective says of a solve:
RAN_AWAY = 40.0  # an action, more than least motion: freed poses went astray
UNCHANGED = 0.5  # more data that add less leave the optimum as it was
RESTORED = 1.0  # what a reduction dropped may add when it is restored
UPDATE_COST, UPDATE_SHARE = 3.0, 2.0  # [nats], [cost of an action so far] of an update

# Between solves to the end:
UNTOUCHED_FACE = 3.0  # a face that no touch supports must gain as much: odds of 20 to 1
NEGLIGIBLE = 40.0  # behind the best optimum: of no weight beside it
CLOSE_OPTIMUM = 3.0  # optima within odds of 20 to 1 are all solved in free motion

# Between a model and a larger one that contains it:
LARGER_MODEL = 3.0  # that a freed assumption must gain: odds of 20 to 1
MOVED = 3.0  # by a motion between two actions that needs an explanation: the same odds

# Profile likelihood:
PROFILE_RISE = 3.0  # at which a profile ends; half of it for a pose: a rougher solve
ONE_SIGMA = 0.5  # of a Gaussian at one standard deviation
BETTER_OPTIMUM = 0.1  # by which another optimum is better
