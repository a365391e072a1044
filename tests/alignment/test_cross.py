import numpy as np
import pytest

from alignment.cross import cross, cross_matrix


def test_sign_by_hand():
    """North x east = down: (1, 0, 0) x (0, 1, 0) = (0, 0, 1)."""
    assert (cross_matrix([1.0, 0, 0]) @ [0.0, 1, 0]).tolist() == [0, 0, 1]
    assert cross_matrix([1, 2, 3]).tolist() == [[0, -3, 2], [3, 0, -1], [-2, 1, 0]]
    assert cross(np.array([[1.0, 0, 0]]), np.array([[0.0, 1, 0]])).tolist() == [[0, 0, 1]]


@pytest.mark.parametrize("lead", [(), (4,), (2, 5)])
def test_of_any_lead_as_numpy(lead):
    v, u = np.random.default_rng(1).standard_normal((2, *lead, 3))
    product = (cross_matrix(v) @ u[..., None])[..., 0]
    np.testing.assert_allclose(product, np.cross(v, u), rtol=0, atol=1e-15)  # rounding of O(1)
    rows = cross(v.reshape(-1, 3), u.reshape(-1, 3)).reshape(v.shape)
    np.testing.assert_array_equal(rows, np.cross(v, u))
