"""The paper's numerical example, run many times: every estimator against the truth."""

from rotorid.demo.findings import findings
from rotorid.demo.paper import ESTIMATORS, DemoResult, run_demo

__all__ = ["ESTIMATORS", "DemoResult", "findings", "run_demo"]
