"""Pictures and films of estimates and explorations, drawn by matplotlib.

In: an `Estimate` or a list of steps.  Out: matplotlib figures, a film.  Imported only
where something is drawn.

- `scene`, `drawing`, `faces`, `animation`: object and fingers in space
- `charts`: impulses, cones, costs, errors;  `gain_map`: information gain by action
- `style`: colours, fonts, and the checks of axes
"""
