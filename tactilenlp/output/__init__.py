"""Write an estimate to files that can be read without this package.

In: an `Estimate`, read by its public attributes.  Out: HTML, meshes, MJCF, URDF.

- `summary`: a paragraph in words; `orientation`: the turn about the ground's normal
- `html_report`: one interactive page, without a network
- `export`: STL, OBJ, PLY, GLB, MJCF, URDF
- `colours`: of standard deviations and fingers
"""
