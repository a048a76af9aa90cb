"""The paper's cases and sweeps, run and judged: published beside own values, and the figures."""
