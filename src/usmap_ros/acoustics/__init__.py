"""The physics that simulator and reconstruction share: medium, pulse, beam, propagation."""
