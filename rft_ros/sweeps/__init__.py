"""Design studies: tools x motions x media x models, on one machine or many."""
