"""Files in the .npz format: plain arrays, and results with a JSON header.

Nothing in a file is executed (no pickle), and any reader of .npz files can open one.
The header of a result holds format, version and the libraries that wrote it.  Its
`content` is a tree in which {"array": name} stands for an array of the file, {"kind":
name, "fields": {...}} for one of our dataclasses, and {"dict": ...} and {"list": ...}
for dictionaries and sequences.  A dataclass may make itself of the fields of a file by
a class method `from_file`.
"""

from __future__ import annotations

import json
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import MISSING
from dataclasses import fields as dataclass_fields
from functools import partial
from importlib.metadata import version

import numpy as np

from ..errors import FileError, MeasurementError, TactileError
from .layout import check_kinds, check_layout
from .whole_file import open_file, whole_file

UNREADABLE = (  # AttributeError, TypeError: np.load gave an array, it was an .npy file
    *(ValueError, EOFError, OSError, RuntimeError, AttributeError, TypeError),
    *(NotImplementedError, zipfile.BadZipFile, zlib.error, struct.error, MemoryError),
    *(SyntaxError, tokenize.TokenError, OverflowError),  # of a damaged array's header
)
MALFORMED = (ValueError, KeyError, TypeError, AttributeError, RecursionError)
MB = 2**20
LARGEST_CONTENT = 256 * MB  # of a file: two fingers take 130 MB in 7 h at 30 Hz
LARGEST_RESULT = 4096 * MB  # of one of our own: 150 explored actions take 256 MB
SHOWN_NAMES = 5  # of the arrays of a file without header, in the error
LIBRARIES = ("tactilenlp", "casadi", "numpy", "scipy")


def write_npz(path, arrays: dict) -> None:
    """Write arrays by name to an .npz file at exactly this path, completely or not."""
    with whole_file(path) as file:
        np.savez_compressed(file, **arrays)


def read_npz(
    path: str | os.PathLike, keys: Iterable | None, error: type = MeasurementError,
    most: float | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Return the arrays of an .npz file, those of `keys` that it has (None: all).

    most [bytes]: of content, by default LARGEST_CONTENT.  Raises `error` if the file is
    no .npz file of plain arrays, NoFileError if there is no file.
    """
    arrays, where = {}, os.fspath(path) if isinstance(path, os.PathLike) else path
    with open_file(path, error) as stream:
        try:
            check_declared(stream, error, where, most or LARGEST_CONTENT)
            with np.load(stream, allow_pickle=False) as archive:
                if keys is not None and "header" in archive and "header" not in keys:
                    raise _another_kind(keys, error, where)
                keys = archive.files if keys is None else keys
                for where in (key for key in keys if key in archive):
                    arrays[where] = archive[where]
        except TactileError:
            raise
        except UNREADABLE as bad:
            empty = stream.seek(0, os.SEEK_END) == 0
            raise error(
                "cannot be read", where=where,
                got="an empty file" if empty else f"{type(bad).__name__}: {bad}",
                expected="an .npz file of plain arrays", next="use numpy.savez",
            ) from bad  # fmt: skip
    return arrays


def _another_kind(keys, error: type, where: str):
    """Return the error for a saved result from which arrays of its own are read."""
    return error(
        "another kind of file", where=where, got="a saved estimate or exploration",
        expected=f"at least one of {', '.join(keys)}",
        next="load it by its class: Estimate.load(path).measurements",
    )  # fmt: skip


def check_declared(stream, error: type, where: str, most: float) -> None:
    """Raise `error` if an .npz file declares more content than `most` [bytes].

    Read from the directory of the archive, before anything is unpacked; no member
    yields more bytes than its entry there declares.
    """
    with zipfile.ZipFile(stream) as archive:
        declared = sum(entry.file_size for entry in archive.infolist())
    stream.seek(0)
    if declared > most:
        raise error(
            "too large", where=where, got=f"arrays of {declared / MB:.0f} MB",
            expected=f"at most {most / MB:.0f} MB when unpacked",
            next="split the recording, or select what is needed",
        )  # fmt: skip


def write_result(path, name: str, number: int, content, kinds: dict) -> None:
    """Write content as version `number` of the format `name`, completely or not at all.

    kinds: the dataclasses that may occur in it, by name.
    """
    arrays: dict[str, np.ndarray] = {}
    header = {"format": name, "version": number, "written_by": versions()}
    header["content"] = _pack(content, "", arrays, kinds)
    write_npz(path, {"header": np.array(json.dumps(header)), **arrays})


def read_result(path, name: str, number: int, kinds: dict, kind: type):
    """Return an object of class `kind` as `write_result` wrote it, to the last digit.

    Raises FileError for files of another format, version or class.
    """
    arrays = read_npz(path, None, error=FileError, most=LARGEST_RESULT)
    if "header" not in arrays:
        some = ", ".join(sorted(arrays)[:SHOWN_NAMES])
        raise FileError(
            f"not an {name}", where=str(path), got=f"no header, but {some}, ...",
            expected="what `save` wrote", next="Measurements.load reads recordings",
        )  # fmt: skip
    try:
        header = json.loads(str(arrays.pop("header")))
        foreign = partial(_foreign, header, str(path))
        _check_version(header, name, number, str(path), foreign)
        _check_fields(header["content"], kinds, foreign)
        result = _unpack(header["content"], arrays, kinds)
    except FileError:
        raise
    except MALFORMED as bad:
        got = f"{type(bad).__name__}: {bad}"
        raise FileError(
            "the header is damaged", where=str(path), got=got,
            next="read another copy of the file; save the result again",
        ) from bad  # fmt: skip
    if not isinstance(result, kind):
        raise FileError(
            f"not an {name}", where=str(path), got=type(result).__name__,
            expected=f"a file that {kind.__name__}.save has written",
        )  # fmt: skip
    return result


def format_of(path) -> str:
    """Return the format that a file's header names, "" if it names none."""
    arrays = read_npz(path, ["header"], error=FileError, most=LARGEST_RESULT)
    header = arrays.get("header")
    try:
        return str(json.loads(str(header))["format"])
    except MALFORMED:
        return ""


def versions() -> dict[str, str]:
    """Return the versions of the libraries that made a result."""
    return {name: version(name) for name in LIBRARIES}


def _check_version(header, name: str, number: int, where: str, foreign) -> None:
    """Raise FileError unless a header names this format and version."""
    stated = header["format"]
    if "version" not in header and isinstance(stated, int):
        # The first files had only a number, and were estimates.
        of = "" if name == "estimate" else " of an estimate"
        expected = f"version {number}{of and f' of an {name}'}"
        raise foreign(f"version {stated}{of}", expected)
    if stated != name:
        raise FileError(
            f"not an {name}", where=where, got=f"an {stated}",
            next=f"load it as an {stated}",
        )  # fmt: skip
    if header["version"] != number:
        raise foreign(f"version {header['version']}", f"version {number}")


def _foreign(header: dict, where: str, got: str, expected: str) -> FileError:
    """Return the error for a file of another version."""
    by = header.get("written_by", {}).get("tactilenlp", "an older one")
    here = version("tactilenlp")
    return FileError(
        "written in another version of this format", got=got, expected=expected,
        next=f"read it with the tactilenlp that wrote it ({by}, this is {here}), or "
        "estimate the measurements again", where=where,
    )  # fmt: skip


def _check_fields(tree, kinds: dict, foreign: Callable) -> None:
    """Raise foreign(got, expected) if a dataclass in the file has other fields.

    A field that has a default may be missing: it is younger than the file.  All are
    compared before one is made, which may fail in a file of another version.
    """
    if isinstance(tree, dict) and "kind" in tree:
        kind, tree = tree["kind"], tree["fields"]
        ours = _fields_by_name(kinds[kind])
        needed = {name for name, field in ours.items() if not _has_default(field)}
        if differ := sorted((needed - set(tree)) | (set(tree) - set(ours))):
            words = [f"{'no ' if f in ours else ''}{kind}.{f}" for f in differ]
            expected = f"the {len(ours)} fields of {kind} in this version"
            raise foreign(", ".join(words), expected)
    if isinstance(tree, (dict, list)):
        for branch in tree.values() if isinstance(tree, dict) else tree:
            _check_fields(branch, kinds, foreign)


def _fields_by_name(kind) -> dict:
    """Return the fields of a dataclass by their names in a file.

    These are those of its NAMES_IN_FILES, for fields that have another name by now.
    """
    older = getattr(kind, "NAMES_IN_FILES", {})
    return {older.get(f.name, f.name): f for f in dataclass_fields(kind)}


def _has_default(field) -> bool:
    return not (field.default is MISSING and field.default_factory is MISSING)


def _pack(value, name: str, arrays: dict, kinds: dict):
    """Return a JSON tree of `value`; its arrays are stored in `arrays` by path."""
    if isinstance(value, np.ndarray) or hasattr(value, "_fields"):  # a named tuple
        arrays[name] = np.asarray(value)
        return {"array": name}

    def inner(pairs):
        return {k: _pack(v, f"{name}/{k}".strip("/"), arrays, kinds) for k, v in pairs}

    if type(value).__name__ in kinds:
        own = _fields_by_name(type(value)).items()
        fields = inner((name, getattr(value, field.name)) for name, field in own)
        return {"kind": type(value).__name__, "fields": fields}
    if isinstance(value, dict):
        return {"dict": inner(value.items())}
    if isinstance(value, (tuple, list)):
        return {"list": [*inner(enumerate(value)).values()]}
    return value.item() if isinstance(value, np.generic) else value


def _unpack(tree, arrays: dict, kinds: dict):
    """Return the value that a JSON tree stands for; the inverse of `_pack`."""
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return arrays[tree["array"]]

    def inner(pairs):
        return {k: _unpack(v, arrays, kinds) for k, v in pairs}

    if "dict" in tree:
        return inner(tree["dict"].items())
    if "list" in tree:
        return tuple(inner(enumerate(tree["list"])).values())
    kind = kinds[tree["kind"]]
    own = _fields_by_name(kind)
    fields = {own[k].name: v for k, v in inner(tree["fields"].items()).items()}
    check_kinds(kind, fields)
    thing = getattr(kind, "from_file", kind)(**fields)
    check_layout(thing)
    return thing
