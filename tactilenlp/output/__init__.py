"""Hand an estimate to people and to other tools: files that need nothing of ours.

In: an `Estimate`, read by its public attributes.  Out: HTML, meshes, MJCF, URDF.

- `html_report`: one page to turn and to scrub through, without a network
- `export`: STL, OBJ, PLY, GLB, MJCF, URDF
- `colours`: one colour for each standard deviation
"""
