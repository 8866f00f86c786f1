"""Check arguments, read and write .npz files, show progress, survive Ctrl-C.

In: what users pass, paths.  Out: checked values; files that are whole or not there.
Nothing here knows of fingers, bodies or programmes.

- `validation`: argument checks that raise typed errors
- `npz`: arrays and frozen dataclasses to and from one file, without pickle
- `progress`, `interrupt`: bars on a terminal; Ctrl-C that reaches compiled code
"""
