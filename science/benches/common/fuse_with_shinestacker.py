"""Fuses the pictures of a folder with shinestacker: fuse_with_shinestacker.py WORK FOLDER, the folder relative to WORK.

Puts one picture into WORK/pyramid and one into WORK/depth_map.
"""

import sys

from shinestacker.algorithms.depth_map import DepthMapStack
from shinestacker.algorithms.pyramid import PyramidStack
from shinestacker.algorithms.stack import FocusStack
from shinestacker.algorithms.stack_framework import StackJob

work, folder = sys.argv[1:]
for name, algorithm in (("pyramid", PyramidStack), ("depth_map", DepthMapStack)):
    job = StackJob("job", work, input_path=folder)
    job.add_action(FocusStack(name, algorithm(), output_path=name))
    job.run()
