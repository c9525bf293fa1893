"""How good the results are, against people, peers and truth."""
