"""The paper's numerical example, run many times: every estimator against the truth."""

from rotorid.demo.findings import findings
from rotorid.demo.run import ESTIMATORS, DemoResult, Example, run_demo

__all__ = ["ESTIMATORS", "DemoResult", "Example", "findings", "run_demo"]
