"""Count lines and named numbers at module level of the packages search and estimation.

    python examples/benchmarks/count_code.py [folder of a checkout] [packages ...]

A named number: an upper-case name that a module assigns a value with a number in it;
`A, B = 1, 2` counts as two.
"""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = tuple(
    f"tactilenlp/{name}" for name in ("search", "estimation", "refinement", "interface")
)


def named_numbers(text: str) -> int:
    """Return how many upper-case names a module assigns numbers to."""
    count = 0
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets = [node.target]
        else:
            continue
        constants = (n for n in ast.walk(node.value) if isinstance(n, ast.Constant))
        if not any(type(c.value) in (int, float) for c in constants):
            continue
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
        count += sum(name.isupper() for name in names)
    return count


def main(root=ROOT, *packages) -> None:
    whole = [0, 0]
    for package in packages or PACKAGES:
        texts = [p.read_text("utf-8") for p in sorted(Path(root, package).glob("*.py"))]
        lines = sum(len(text.splitlines()) for text in texts)
        numbers = sum(named_numbers(text) for text in texts)
        whole = [whole[0] + lines, whole[1] + numbers]
        print(f"{package}: {len(texts)} files, {lines} lines, {numbers} named numbers")
    print(f"sum: {whole[0]} lines, {whole[1]} named numbers")


if __name__ == "__main__":
    main(*sys.argv[1:])
