"""A levitated machine beside its truth, and the paper's example by every estimator."""

from rotorid.demo.paper import ESTIMATORS, DemoResult, findings, run_demo

__all__ = ["ESTIMATORS", "DemoResult", "findings", "run_demo"]
