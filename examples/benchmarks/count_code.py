"""Count lines, and named numbers at module level, of the search and the estimation.

    python examples/benchmarks/count_code.py [--against COMMIT]

An upper-case name that a module assigns a value with a number in it; `A, B = 1, 2` are
two.  Both are of HEAD, and of a commit, where packages may still be flat modules.
"""

import argparse
import ast
import subprocess
from pathlib import Path, PurePosixPath

FOLDER = Path(__file__).resolve().parent
PARTS = {  # packages and modules now, modules before there were packages
    "search": "search local tracking problem/job problem/hypothesis  rivals search "
    "hypothesis guess trial solving race planes polytopes carving profile extend "
    "floating tumble",
    "estimation": "estimation refinement interface problem/options  hull_update "
    "unfinished observed options readout refine request result estimate",
}


def git(*arguments: str) -> str:
    """Return what git writes."""
    call = ["git", "-C", str(FOLDER), *arguments]
    return subprocess.run(call, check=True, capture_output=True, text=True).stdout


def named_numbers(text: str) -> int:
    """Return how many upper-case names a module assigns numbers to."""
    count = 0
    for node in ast.parse(text).body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value:
            constants = (n for n in ast.walk(node.value) if isinstance(n, ast.Constant))
            if any(type(c.value) in (int, float) for c in constants):
                names = (n for n in ast.walk(node) if isinstance(n, ast.Name))
                stored = (n.id for n in names if isinstance(n.ctx, ast.Store))
                count += sum(name.isupper() for name in stored)
    return count


def places(path: PurePosixPath) -> tuple[str, str]:
    """Return the package that a module is in, or its own name; the module's path."""
    first, *_ = within = path.with_suffix("").parts[1:]
    return first, "/".join(within)


def counted(commit: str) -> dict[str, tuple[int, int]]:
    """Return lines and named numbers of each part at a commit."""
    listed = git("ls-tree", "-r", "--full-tree", "--name-only", commit, "tactilenlp")
    paths = [PurePosixPath(name) for name in listed.split() if name.endswith(".py")]
    found = {}
    for part, names in PARTS.items():
        chosen = [p for p in paths if {*places(p)} & {*names.split()}]
        texts = [git("show", f"{commit}:{path}") for path in chosen]
        lines = sum(len(text.splitlines()) for text in texts)
        found[part] = lines, sum(map(named_numbers, texts))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", metavar="COMMIT")
    commits = [c for c in (parser.parse_args().against, "HEAD") if c]
    for commit in commits:
        found = counted(commit)
        found["both"] = tuple(map(sum, zip(*found.values(), strict=True)))
        words = (f"{k} {n} lines, {m} numbers" for k, (n, m) in found.items())
        print(f"{commit}: {'; '.join(words)}")


if __name__ == "__main__":
    main()
