"""Files in the .npz format: plain arrays, and results with a JSON header.

Nothing in a file is executed (no pickle), and any reader of .npz files can open one.
The header of a result holds format, version and the libraries that wrote it.  Its
`content` is a tree in which {"array": name} stands for an array of the file, {"kind":
name, "fields": {...}} for one of our dataclasses, and {"dict": ...} and {"list": ...}
for dictionaries and sequences.
"""

from __future__ import annotations

import json
import os
import stat
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable
from contextlib import contextmanager
from dataclasses import MISSING
from importlib.metadata import version
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np

from ..errors import FileError, MeasurementError
from .validation import check_path

UNREADABLE = (  # AttributeError, TypeError: np.load gave an array, it was an .npy file
    *(ValueError, EOFError, OSError, RuntimeError, AttributeError, TypeError),
    *(NotImplementedError, zipfile.BadZipFile, zlib.error, struct.error, MemoryError),
    *(SyntaxError, tokenize.TokenError, OverflowError),  # of a damaged array's header
)
MALFORMED = (ValueError, KeyError, TypeError, AttributeError, RecursionError)
SHOWN_NAMES = 5  # of the arrays of a file without header, in the error
LIBRARIES = ("tactilenlp", "casadi", "numpy", "scipy")


def write_npz(path, arrays: dict) -> None:
    """Write arrays by name to an .npz file at exactly this path, completely or not."""
    check_path(path)
    check_folder(path, str(path))
    with _whole(path) as file:
        np.savez_compressed(file, **arrays)


def read_npz(
    path: str | os.PathLike, keys: Iterable | None, error: type = MeasurementError
) -> dict[str, np.ndarray]:
    """Return the arrays of an .npz file, those of `keys` that it has (None: all).

    Raises `error` if the file is no .npz file of plain arrays, FileNotFoundError if
    there is no file.
    """
    check_path(path)
    arrays, where = {}, os.fspath(path)
    with open(path, "rb") as stream:
        try:
            with np.load(stream, allow_pickle=False) as archive:
                keys = archive.files if keys is None else keys
                for where in (key for key in keys if key in archive):
                    arrays[where] = archive[where]
        except UNREADABLE as bad:
            parts = {"where": where, "got": f"{type(bad).__name__}: {bad}"}
            parts |= {"expected": "an .npz file of plain arrays"}
            raise error("cannot be read", next="use numpy.savez", **parts) from bad
    return arrays


def write_result(path, name: str, number: int, content, kinds: dict) -> None:
    """Write content as version `number` of the format `name`, completely or not at all.

    kinds: the dataclasses that may occur in it, by name.
    """
    check_path(path)
    arrays: dict[str, np.ndarray] = {}
    header = {"format": name, "version": number, "written_by": versions()}
    header["content"] = _pack(content, "", arrays, kinds)
    write_npz(path, {"header": np.array(json.dumps(header)), **arrays})


def read_result(path, name: str, number: int, kinds: dict, kind: type):
    """Return an object of class `kind` as `write_result` wrote it, to the last digit.

    Raises FileError for files of another format, version or class.
    """
    arrays = read_npz(path, None, error=FileError)
    if "header" not in arrays:
        some = ", ".join(sorted(arrays)[:SHOWN_NAMES])
        raise FileError(
            f"not an {name}", where=str(path), got=f"no header, but {some}, ...",
            expected="what `save` wrote", next="Measurements.load reads recordings",
        )  # fmt: skip
    try:
        header = json.loads(str(arrays.pop("header")))
        _check_version(header, name, number, str(path))
        tree = header["content"]
        _check_fields(tree, kinds, header, str(path))
        found = _unpack(tree, arrays, kinds)
    except FileError:
        raise
    except MALFORMED as bad:
        got = f"{type(bad).__name__}: {bad}"
        raise FileError("the header is damaged", where=str(path), got=got) from bad
    if not isinstance(found, kind):
        got = type(found).__name__
        raise FileError(f"not an {name}", where=str(path), got=got)
    return found


def format_of(path) -> str:
    """Return the format that a file's header names, "" if it names none."""
    header = read_npz(path, ["header"], error=FileError).get("header")
    try:
        return str(json.loads(str(header))["format"])
    except MALFORMED:
        return ""


def versions() -> dict[str, str]:
    """Return the versions of the libraries that made a result."""
    return {name: version(name) for name in LIBRARIES}


def check_folder(path, where: str) -> None:
    """Raise FileError unless the folder of a file to be written exists."""
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise FileError(
            "no such folder", where=where, got=str(folder),
            expected="a file in a folder that exists",
            next="make the folder, or write elsewhere",
        )  # fmt: skip
    if Path(path).is_dir():  # an empty path is the current folder
        expected = "the path of a file"
        got = repr(str(path))
        raise FileError("a folder", where=where or "path", got=got, expected=expected)


@contextmanager
def _whole(path):
    """Open a temporary file that replaces `path` once it is completely written.

    Its name is unique, as another program may be writing to the same path.
    """
    path = Path(path)
    where = {"dir": path.parent, "prefix": f".{path.name}."}
    with NamedTemporaryFile(**where, delete=False) as part:
        try:
            yield part
            part.close()
            os.chmod(part.name, _mode(path))
            os.replace(part.name, path)
        except BaseException:  # Ctrl-C as well
            part.close()
            Path(part.name).unlink(missing_ok=True)
            raise


def _mode(path: Path) -> int:
    """Return the permissions of the file to be replaced, or those of new files."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    mask = os.umask(0)  # cannot be read without being set
    os.umask(mask)
    return 0o666 & ~mask


def _check_version(header: dict, name: str, number: int, where: str) -> None:
    """Raise FileError unless a header names this format and version."""
    found = header["format"]
    if "version" not in header and isinstance(found, int):
        # The first files had only a number, and were estimates.
        of = "" if name == "estimate" else " of an estimate"
        expected = f"version {number}{of and f' of an {name}'}"
        raise _foreign(f"version {found}{of}", expected, header, where)
    if found != name:
        raise FileError(f"not an {name}", where=where, got=f"an {found}")
    if header["version"] != number:
        got = f"version {header['version']}"
        raise _foreign(got, f"version {number}", header, where)


def _foreign(got: str, expected: str, header: dict, where: str) -> FileError:
    """Return the error for a file of another version."""
    by = header.get("written_by", {}).get("tactilenlp", "an older one")
    here = version("tactilenlp")
    return FileError(
        "written in another version of this format", got=got, expected=expected,
        next=f"read it with the tactilenlp that wrote it ({by}, this is {here}), or "
        "estimate the measurements again", where=where,
    )  # fmt: skip


def _check_fields(tree, kinds: dict, header: dict, where: str) -> None:
    """Raise FileError if a dataclass in the file has other fields than here.

    A field that has a default may be missing: it is younger than the file.
    """
    if isinstance(tree, dict) and "kind" in tree:
        kind, fields = tree["kind"], tree["fields"]
        ours = kinds[kind].__dataclass_fields__
        needed = {name for name, field in ours.items() if not _has_default(field)}
        if differ := sorted((needed - set(fields)) | (set(fields) - set(ours))):
            words = [f"{'no ' if f in ours else ''}{kind}.{f}" for f in differ]
            expected = f"the {len(ours)} fields of {kind} in this version"
            raise _foreign(", ".join(words), expected, header, where)
        tree = fields
    for branch in _branches(tree):
        _check_fields(branch, kinds, header, where)


def _has_default(field) -> bool:
    return not (field.default is MISSING and field.default_factory is MISSING)


def _branches(tree):
    if isinstance(tree, dict):
        return tree.values()
    return tree if isinstance(tree, list) else ()


def _pack(value, name: str, arrays: dict, kinds: dict):
    """Return a JSON tree of `value`; its arrays are stored in `arrays` by path."""
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {"array": name}

    def inner(pairs):
        return {k: _pack(v, f"{name}/{k}".strip("/"), arrays, kinds) for k, v in pairs}

    if type(value).__name__ in kinds:
        fields = type(value).__dataclass_fields__
        fields = inner((k, getattr(value, k)) for k in fields)
        return {"kind": type(value).__name__, "fields": fields}
    if isinstance(value, dict):
        return {"dict": inner(value.items())}
    if isinstance(value, (tuple, list)):
        return {"list": [*inner(enumerate(value)).values()]}
    return value.item() if isinstance(value, np.generic) else value


def _unpack(tree, arrays: dict, kinds: dict):
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return arrays[tree["array"]]
    if "dict" in tree:
        return {k: _unpack(v, arrays, kinds) for k, v in tree["dict"].items()}
    if "list" in tree:
        return tuple(_unpack(v, arrays, kinds) for v in tree["list"])
    kind = kinds[tree["kind"]]
    fields = {k: _unpack(v, arrays, kinds) for k, v in tree["fields"].items()}
    for name, value in fields.items():
        declared = kind.__dataclass_fields__[name].type
        if declared == "np.ndarray" and not isinstance(value, np.ndarray):
            raise TypeError(f"{name} of {kind.__name__} is no array")
    return kind(**fields)
