"""Which cells a ping sees, how much of its sound gets there, and what it heard of them."""
