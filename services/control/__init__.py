"""The control plane: hands trials to cells, keeps results, answers REST."""
