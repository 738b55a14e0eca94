"""Products of tall, narrow matrices against those of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from model.kernels import products

RNG = np.random.default_rng(9400)


@pytest.mark.parametrize("rows", [1, 3, 4, 997])
def test_inner_is_the_product_over_the_samples(rows: int) -> None:
    left, right = RNG.standard_normal((rows, 5)), RNG.standard_normal((rows, 66))
    assert products.inner(left, right) == pytest.approx(left.T @ right, rel=1e-12, abs=1e-12)


def test_orthonormal_columns_span_the_same() -> None:
    columns = RNG.standard_normal((500, 4))
    found = products.orthonormal(columns)
    assert found.T @ found == pytest.approx(np.eye(4), abs=1e-14)
    assert found @ (found.T @ columns) == pytest.approx(columns, abs=1e-12)


def test_nearly_parallel_columns_become_orthogonal_all_the_same() -> None:
    first = RNG.standard_normal(500)
    found = products.orthonormal(
        np.column_stack([first, first + 1e-7 * RNG.standard_normal(500), np.ones(500)])
    )
    assert found.T @ found == pytest.approx(np.eye(3), abs=1e-13)


def test_a_dependent_column_becomes_zero() -> None:
    first = RNG.standard_normal(500)
    found = products.orthonormal(np.column_stack([first, 3.0 * first]))
    assert not found[:, 1].any()


def test_what_lies_along_a_basis_is_taken_out() -> None:
    basis = products.orthonormal(RNG.standard_normal((500, 3)))
    columns = RNG.standard_normal((500, 7))
    wanted = columns - basis @ (basis.T @ columns)
    products.take_out(basis, columns)
    assert columns == pytest.approx(wanted, abs=1e-13)
