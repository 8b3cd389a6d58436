"""The compiled kernel: its loops, the chunk of plates that they work on, and compilation with its cache on disk.

Import from its modules: what uses only one of them need not load the others. The physics are beside this package.
"""
