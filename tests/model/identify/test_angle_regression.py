"""Regressors over cells of angle and their sums are what plain matrices give, however a basis grew."""

from __future__ import annotations

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify import angle_regression
from model.identify.angle_fit import solve_angle
from model.identify.angle_regression import CELLS, AngleRegression, Basis, Cells
from model.kernels import regression as kernels
from model.kinematic_error import design_matrix
from model.units import REVOLUTION

RATIO = 50.0
FEW = Basis(RATIO, (1 / RATIO, 1.0, 2.0, 3.0 - 2.0 / RATIO))
MORE = Basis(RATIO, (1 / RATIO, 1.0, 1.37, 2.0, 2.0 + 5.0 / RATIO, 3.0 - 2.0 / RATIO, 12.0))


def sampled(direction: float) -> Cells:
    """One sample in every tenth cell or so, anywhere in it, with noise as its value."""
    random = np.random.default_rng(1)
    cell = np.sort(random.choice(51 * CELLS, 600, replace=False))
    angle = direction * (cell + random.random(600)) * (REVOLUTION / CELLS)
    regression = AngleRegression(RATIO)
    regression.add(angle, random.standard_normal(600))
    return regression.cells()


def plain(cells: Cells, basis: Basis) -> np.ndarray:
    """Constant, trend, cosines and sines at the cells; a cell of one sample has no mean to take."""
    design = design_matrix(cells.angle, basis.orders)
    design[:, 1] = (cells.angle - cells.first_angle) / cells.trend_scale
    return design


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("in_pieces", [False, True])
def test_sums_are_those_of_plain_matrices(
    direction: float, in_pieces: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if in_pieces:
        monkeypatch.setattr(angle_regression, "PIECE", 16 * CELLS)
    cells = sampled(direction)
    regressors, weighted = cells.regressors, cells.count * cells.mean[0]
    for basis in (FEW, MORE, FEW):
        every = np.ones(len(basis.orders), dtype=bool)
        design, values = plain(cells, basis), np.arange(1.0, basis.parameters + 1.0)
        counted = cells.count[:, None] * design
        halved = 0.5 * cells.count
        for weight, factor in ((None, 1.0), (halved, 0.5)):
            normal = regressors.normal(basis, every, weight)
            np.testing.assert_allclose(normal, factor * counted.T @ design, atol=1e-9)
        products = regressors.products(basis, every, weighted)
        np.testing.assert_allclose(products, weighted @ design, atol=1e-9)
        held = cells.count > 0.0
        series = regressors.combination(basis, every, values)
        np.testing.assert_allclose(series[held], (design @ values)[held], atol=1e-9)
        rows = counted.reshape(cells.rows, CELLS, -1).sum(axis=1).T
        np.testing.assert_allclose(regressors.row_sums(basis, every), rows, atol=1e-9)


def test_only_what_is_asked_for_is_answered() -> None:
    cells = sampled(1.0)
    chosen = np.array([True, False, True, False])
    part = np.repeat(np.concatenate([[True], chosen]), 2)
    design = plain(cells, FEW)[:, part]
    normal = cells.regressors.normal(FEW, chosen)
    np.testing.assert_allclose(normal, (cells.count[:, None] * design).T @ design, atol=1e-9)


def test_a_high_order_loses_nothing_in_its_cells() -> None:
    """Forty samples to a cell: means to the third order would leave 6e-5 of order 12."""
    angle = np.linspace(0.0, 51.0 * REVOLUTION, int(51 * CELLS * 40.3))
    basis = Basis(RATIO, (2.0, 12.0))
    regression = AngleRegression(RATIO)
    regression.add(angle, np.cos(2.0 * angle) + 0.5 * np.sin(12.0 * angle))
    fit, _ = solve_angle(regression.cells(), basis)
    np.testing.assert_allclose(fit.values, [0.0, 0.0, 1.0, 0.0, 0.0, 0.5], atol=1e-6)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_samples_on_one_side_of_their_cells_lose_little(direction: float) -> None:
    """Uneven samples in a cell: their third moment counts."""
    random = np.random.default_rng(2)
    cell = np.arange(51 * CELLS)[:, None]
    angle = direction * (cell + np.sort(random.random((51 * CELLS, 6)) ** 3, axis=1)).ravel()
    angle *= REVOLUTION / CELLS
    basis = Basis(RATIO, (2.0, 12.0))
    regression = AngleRegression(RATIO)
    regression.add(angle, np.cos(2.0 * angle) + 0.5 * np.sin(12.0 * angle))
    fit, _ = solve_angle(regression.cells(), basis)
    np.testing.assert_allclose(fit.values[2:], [1.0, 0.0, 0.0, 0.5], atol=2e-6)


def test_compiled_algebra_is_that_of_the_library() -> None:
    random = np.random.default_rng(3)
    basis = random.standard_normal((41, 37))
    matrix = basis.T @ basis + 0.1 * np.eye(37)
    other = random.standard_normal((6, 37))
    np.testing.assert_allclose(kernels.times_transposed(other, basis), other @ basis.T, atol=1e-12)
    root = kernels.square_root(matrix)
    np.testing.assert_allclose(root @ root.T, matrix, atol=1e-11)
    np.testing.assert_allclose(kernels.inverse_of(root) @ matrix, np.eye(37), atol=1e-9)
    largest = np.linalg.eigvalsh(matrix)[-1]
    assert kernels.largest_eigenvalue(matrix) == pytest.approx(largest, rel=0.02)


def test_a_matrix_with_empty_rows_has_a_root_with_empty_rows() -> None:
    matrix = np.diag([4.0, 0.0, 9.0])
    matrix[0, 2] = matrix[2, 0] = 1.0
    root = kernels.square_root(matrix)
    np.testing.assert_allclose(root @ root.T, matrix, atol=1e-12)
    assert not root[1].any()
    line = np.random.default_rng(4).standard_normal(20)
    root = kernels.square_root(np.outer(line, line))
    np.testing.assert_allclose(root @ root.T, np.outer(line, line), atol=1e-12)


def test_orders_that_the_samples_cannot_separate_are_refused() -> None:
    regression = AngleRegression(RATIO)
    angle = np.arange(0.0, 51.0, 1.0 / 24.0) * REVOLUTION + 1e-3
    regression.add(angle, np.cos(angle))
    for apart in (1e-8, 3e-8):
        twins = Basis(RATIO, (2.0, 2.0 + apart))
        with pytest.raises(IdentificationError, match="cannot separate"):
            solve_angle(regression.cells(), twins)
