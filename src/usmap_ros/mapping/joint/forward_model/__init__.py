"""Powers of cells that explain what was heard, and the evidence that each stands."""
