"""The physics: medium, pulse, beam pattern and propagation, shared by simulator and reconstruction."""
