"""What silence refutes, by how the surfaces of the place answer."""
