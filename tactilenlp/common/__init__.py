"""Check arguments, read and write .npz files, show progress, survive Ctrl-C.

In: what users pass, paths.  Out: checked values; files that are whole or not there.
Nothing here knows of fingers, bodies or programmes.

- `validation`, `named`: argument checks that raise typed errors; dicts that do
- `npz`, `layout`, `whole_file`, `file_lock`: arrays and frozen dataclasses in one file
- `progress`, `interrupt`, `deadline`: bars, Ctrl-C and time limits
- `threads`, `library_cache`: BLAS on one thread; compiled functions on disk
- `brief`: how dataclasses print
"""
