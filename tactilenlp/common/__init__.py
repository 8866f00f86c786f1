"""Check arguments, read and write .npz files, show progress, handle Ctrl-C.

In: what users pass, paths.  Out: checked values; files that are whole or not there.
Independent of fingers, bodies and programmes.

- `validation`, `named`: argument checks that raise typed errors; dictionaries
  whose missing keys raise them
- `npz`, `layout`, `whole_file`, `file_lock`: arrays and frozen dataclasses in one file
- `progress`, `interrupt`, `deadline`: bars, Ctrl-C and time limits
- `threads`, `library_cache`: BLAS on one thread; compiled functions on disk
- `brief`: how dataclasses print
"""
