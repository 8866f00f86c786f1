"""What a page states beside `build`: its levels, and what solves may do with it.

Only `build` and LEVELS are required.  What a page does not state has the default here;
nothing else reads these members of a page.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

NO_REDUCTIONS = "level", "prompt"  # assumptions that FREED may name beside reductions


@dataclass(frozen=True)
class PageContract:
    """The members of a page in capital letters, each under its name in small ones.

    levels:     tuple of Level, solved one after another
    rough:      levels from guessed poses, which may be centimetres off; none by default
    freed:      names of assumptions that are given up where touches cost too much:
                reductions, "level": the ground leans, or "prompt": sensors are late;
                "rigid", "central" and "aligned" are kept by pages without the name
    reductions: True or False by name, of those that the page requires or forbids
    offsets:    whether `build` begins with `displaced`, so that Scene(sigma_offset=...)
                can be used
    alike:      whether the functions of terms depend on page, shape, scene and motion
                only, so that the problems of an estimate share them
    extends:    whether an estimate of one action more starts from the solution of those
                before, and a solve that is not plausible goes through all levels again;
                such a page has the unknowns of polytope_extension.py, and a page that
                `extend` makes of it is solved from scratch
    """

    levels: tuple = ()
    rough: tuple = ()
    freed: tuple = ()
    reductions: dict = field(default_factory=dict)
    offsets: bool = False
    alike: bool = False
    extends: bool = False

    @property
    def from_guesses(self) -> tuple:
        """The levels from guessed poses: `rough`, else `levels`."""
        return self.rough or self.levels


INHERITED = "LEVELS", "ROUGH", "FREED", "REDUCTIONS", "OFFSETS", "ALIKE"  # by `extend`


def contract_of(page) -> PageContract:
    """Return what a page states: a module, or an object, with `build` and LEVELS."""
    names = [f.name for f in fields(PageContract) if hasattr(page, f.name.upper())]
    return PageContract(**{name: getattr(page, name.upper()) for name in names})
