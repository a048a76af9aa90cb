"""How good plans are: the paper's cases, ground truth, benchmarks, operating points."""
