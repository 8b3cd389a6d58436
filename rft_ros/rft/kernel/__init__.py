"""The compiled kernel: its loops, the chunk of plates that they work on, and compilation with its cache on disk.

`compilation` imports nothing else of `rft`. `chunk` takes from it and from `plates`. The physics beside this package
(`traction`, `memory` and the modules that they use) take from both, and `loops` is on top of them all. So nothing is
imported here: import from the modules.
"""
