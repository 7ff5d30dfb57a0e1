"""From echo cones to a map: evidence, fusion, and whom not to believe."""
