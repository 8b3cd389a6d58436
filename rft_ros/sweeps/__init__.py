"""Design studies: tools x motions x media, on one machine or a cluster."""
