"""
The paper's table
=================

The numerical example of Levy and Arogeti, ten records with fresh noise, by every estimator.
"""

import numpy as np

from rotorid.demo import run_demo
from rotorid.report.demo_plots import draw_rms

result = run_demo(10, rng=np.random.default_rng(2026))
for name in result.estimators:
    rms = result.rms(name)
    print(f"{name:12} rms errors {rms.min():.2g} to {rms.max():.2g} %")
