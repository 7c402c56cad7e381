"""Derivatives of a path by its weights from those of its steps, one after another."""

import ctypes
from collections.abc import Sequence

import numpy as np

from space_envs.codegen.cache import LibraryError
from space_envs.codegen.functions import address
from space_envs.codegen.libraries import load_library, warn_uncompiled
from space_envs.dynamics.rotations import Array

_SOURCE = """
#pragma GCC optimize("O3")
enum {{ N = {joints}, K = {functions}, M = N * K, STEPS = {steps} }};
typedef const double (*matrices)[N][N];

void chain(matrices by_q, matrices by_start, matrices by_middle, matrices by_end,
    matrices slope_by_q, matrices slope_by_v, const double (*shape)[3][K], double (*angle)[N][K][N],
    double (*slope)[N][K][N]) {{
  for (int i = 0; i < M * N; ++i) angle[0][0][0][i] = slope[STEPS][0][0][i] = 0.0;
  for (int k = 0; k < STEPS; ++k)
    for (int i = 0; i < N; ++i) {{
      double moved[M], rate[M];
      for (int c = 0; c < K; ++c)
        for (int j = 0; j < N; ++j) {{
          moved[c * N + j] = by_start[k][i][j] * shape[k][0][c] + by_middle[k][i][j] * shape[k][1][c]
            + by_end[k][i][j] * shape[k][2][c];
          rate[c * N + j] = slope_by_v[k][i][j] * shape[k][0][c];
        }}
      for (int l = 0; l < N; ++l) {{
        const double along = by_q[k][i][l], across = slope_by_q[k][i][l], *before = &angle[k][l][0][0];
        for (int x = 0; x < M; ++x) {{
          moved[x] += along * before[x];
          rate[x] += across * before[x];
        }}
      }}
      for (int x = 0; x < M; ++x) {{
        (&angle[k + 1][i][0][0])[x] = moved[x];
        (&slope[k][i][0][0])[x] = rate[x];
      }}
    }}
}}
"""


class StepChain:
    """Chains the derivatives of N steps of n joints that K functions drive.

    Warns:
        NoCompiledCodeWarning: if it runs without compiled code.
    """

    def __init__(self, joints: int, functions: int, steps: int) -> None:
        self._shape = steps + 1, joints, functions * joints
        try:
            library = load_library(
                _SOURCE.format(joints=joints, functions=functions, steps=steps), native=True
            )
        except LibraryError as error:
            warn_uncompiled(str(error))
            self._loop = None
        else:
            self._loop = library.chain
            self._loop.argtypes, self._loop.restype = [ctypes.c_void_p] * 9, None

    def __call__(self, transfer: Sequence[Array], shape: Array) -> tuple[Array, Array]:
        """Derivatives of the angles and of the slopes, (N + 1, n, K n) each, at the ends of all steps.

        Args:
            transfer: (N, n, n) each, as `FlowFunctions.transfer` gives them. shape: (N, 3, K) functions of
                the phase at the start, the middle and the end of every step.
        """
        if self._loop is None:
            return self._plain(transfer, shape)
        angle, slope = np.empty(self._shape), np.empty(self._shape)
        self._loop(*map(address, (*transfer, shape, angle, slope)))
        return angle, slope

    def _plain(self, transfer: Sequence[Array], shape: Array) -> tuple[Array, Array]:
        by_q, *by_v, slope_by_q, slope_by_v = transfer
        angle, slope = np.zeros(self._shape), np.zeros(self._shape)
        added = np.einsum("ptij,tpc->ticj", np.array(by_v), shape)
        for k in range(len(shape)):
            angle[k + 1] = by_q[k] @ angle[k] + added[k].reshape(angle[k].shape)
            rate = slope_by_v[k][:, None] * shape[k, 0][:, None]
            slope[k] = slope_by_q[k] @ angle[k] + rate.reshape(angle[k].shape)
        return angle, slope
