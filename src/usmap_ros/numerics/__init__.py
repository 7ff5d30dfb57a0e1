"""Mathematics that knows no sonar: arrays, special functions, poses, and compiled loops."""
