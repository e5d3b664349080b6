"""Files: volumes, displacement fields for ITK and Slicer, grids for VTK. Needs the extra ``io``."""
