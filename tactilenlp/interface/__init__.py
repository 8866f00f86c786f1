"""What a caller gives and gets: `Options`, the checked request, the `Estimate`.

In: `Measurements`, `Scene`, a shape, a page, `Options`, perhaps an earlier estimate.
Out: a `Request` with everything checked; an `Estimate` in the frame of the data.

- `session`: `Guess`, `Session`: what a solve may begin with
- `checks`: what a request is checked for, by typed errors before any solve
- `request`: the request as it was read
- `result`: `Estimate`, by name and in SI units
- `readout`: from a solved page to an `Estimate`, with its information
"""
