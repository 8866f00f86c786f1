"""Names of terms and reports that are read where a solution is judged and read out.

A page of one's own whose terms have these names is judged likewise: its touches by the
noise they are expected to have, its impulses as those of the estimate.
"""

FINGER, GROUND = "finger", "ground"  # unknowns: the impulses (normal, t1, t2) [N s]
FINGER_OFFSET = "finger offset"  # unknown, (3, F) [m]: where fingers really are
FINGER_TURN = "finger turn"  # unknown, (3, F) [rad]: of the normals of a finger
CENTRE_OF_MASS = "centre of mass"  # unknown, (3,) [m] from the centroid, body frame
COMPLIANCE = "compliance"  # unknown or parameter, [m] of a fingertip under one weight
DEPTH_OF_TOUCH = "depth"  # unknown, [m] that all felt fingers sit in the surface
TOUCH_SCALE, NORMAL_SCALE = "touch scale", "normal scale"  # parameters, [m], [rad]
TOUCH_TERM = "touch"  # cost of the touches of felt fingers (eq:loss)
FREE_TERM = "free"  # cost of fingers that feel nothing (eq:loss)
BETWEEN_ACTIONS = "between actions"  # cost of the motion while nothing is recorded
BALANCE = "balance"  # begins the names of costs or constraints of the momentum balance
ON_SURFACE, NOT_BELOW = "on the surface", "not below"  # costs of a corner's height
IMPULSE = "impulse"  # report, (3,) [N s] on the object, of all contacts together
WORLD_IMPULSE = "world impulse"  # report, (3,) [N s] of a corner, world frame
FINGER_IMPULSE = "finger impulse"  # report, (3,) [N s] on the object
GROUND_IMPULSE = "ground impulse"  # report, (3,) [N s] on the object
EXACT = ", exact"  # ends the name of a report: how far a rounded constraint is violated
RESPONSE = ", impulse response"  # ends a report: how a constraint moves by one weight
INDENTATION = "indentation"  # report, [m] of a touched fingertip
FINGER_FRICTION = "finger friction"  # coefficient, a parameter or an unknown
GROUND_FRICTION = "ground friction"  # coefficient, a parameter or an unknown
GROUND_GAP = "ground gap"  # constraint of a hard ground
BALL = "ball"  # unknowns of the ball that the prior of a hull's vertices lies about
RADIUS_OF = "radius of finger "  # and its number: considered, as it was told
ROUNDED_EDGES = "rounded edges"  # considered: edges are taken as sharp
SOFT_FINGERTIPS = "soft fingertips"  # considered: fingertips are taken as rigid
PRESSES = "presses on top"  # considered: how hard soft fingertips press down
LATE_NORMALS = "late normals"  # considered: error of their lag
LATE_TOUCHES = "late touches"  # considered: error of their latency
