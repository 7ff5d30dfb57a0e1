"""From echo cones to a map: tiled log-odds grid, evidence, fusion and scoring."""
