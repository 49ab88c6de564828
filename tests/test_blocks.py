import numpy as np
import pytest
from pydantic import ValidationError

from apf.errors import InputError
from apf.towers import BlockSet, BlockSource, rotation_index, write_blocks
from apf.towers.blocks import MOST, TABLE

HALF = np.sqrt(0.5)


def one_block(name="brick", dims=(0.06, 0.08, 0.10), com=(0.01, -0.02, 0.03), mass=0.5):
    return BlockSet((name,), np.array([dims], float), np.array([com], float), np.array([mass], float))


def test_rotated_dims_and_com_of_a_quarter_turn_about_x():
    # y goes to z and z to -y: sides (x, z, y), centre of mass (x, -z, y)
    rotation = rotation_index(np.array([HALF, 0, 0, HALF]))
    block = one_block()
    np.testing.assert_allclose(block.rotated_dims[0, rotation], [0.06, 0.10, 0.08])
    np.testing.assert_allclose(block.rotated_com[0, rotation], [0.01, -0.03, -0.02])


def test_rotation_by_zero_changes_nothing():
    block = one_block()
    np.testing.assert_array_equal(block.rotated_dims[:, 0], block.dims)
    np.testing.assert_array_equal(block.rotated_com[:, 0], block.com)


def test_rotation_keeps_the_com_inside_and_the_volume(blocks):
    assert blocks.rotated_dims.shape == blocks.rotated_com.shape == (7, 24, 3)
    assert (np.abs(blocks.rotated_com) < blocks.rotated_dims / 2).all()
    np.testing.assert_allclose(blocks.rotated_dims.prod(-1), blocks.dims.prod(-1)[:, None] * np.ones(24))


def test_each_side_points_up_in_eight_rotations(blocks):
    for dims, rotated in zip(blocks.dims, blocks.rotated_dims, strict=True):
        for side in dims:
            assert (rotated[:, 2] == side).sum() == 8


def test_subset_keeps_order_and_parameters(blocks):
    some = blocks.subset(np.array([4, 1]))
    assert some.name == (blocks.name[4], blocks.name[1])
    np.testing.assert_array_equal(some.dims, blocks.dims[[4, 1]])
    np.testing.assert_array_equal(some.com, blocks.com[[4, 1]])
    np.testing.assert_array_equal(some.mass, blocks.mass[[4, 1]])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"dims": (0.06, 0.0, 0.10)}, "dim_x, dim_y, dim_z = 0.06, 0, 0.1"),
        ({"dims": (-0.06, 0.08, 0.10)}, "sides must be > 0"),
        ({"dims": (0.06, np.nan, 0.10)}, "sides must be > 0"),
        ({"dims": (0.06, 0.08, np.inf)}, "sides must be > 0"),
        ({"mass": 0.0}, "mass = 0"),
        ({"mass": -1.0}, "mass = -1"),
        ({"mass": np.nan}, "mass = nan"),
        ({"mass": np.inf}, "mass = inf"),
        ({"dims": (0.06, 1e150, 0.10)}, "sides must be 1e-06 to 1e+06 [m]"),
        ({"dims": (0.06, 1e-150, 0.10)}, "sides must be 1e-06 to 1e+06 [m]"),
        ({"mass": 1e150}, "mass = 1e+150; it must be 1e-09 to 1e+09 [kg]"),
        ({"mass": 1e-150}, "it must be 1e-09 to 1e+09 [kg]"),
        ({"com": (0.031, 0, 0)}, "outside the block"),
        ({"com": (0, -0.05, 0)}, "outside the block"),
        ({"com": (0, 0, 0.05)}, "outside the block"),  # on the face: half of 0.10
        ({"com": (0, 0, np.nan)}, "outside the block"),
    ],
)
def test_impossible_blocks_are_refused_by_name(wrong, said):
    with pytest.raises(InputError, match="block brick") as error:
        one_block(**wrong)
    assert said in str(error.value)


def test_names_are_unique_and_there_is_at_least_one_block(cubes):
    with pytest.raises(InputError, match="block a: the name stands twice"):
        BlockSet(("a", "b", "a"), cubes.dims[:3], cubes.com[:3], cubes.mass[:3])
    with pytest.raises(InputError, match="at least one block"):
        BlockSet((), cubes.dims[:0], cubes.com[:0], cubes.mass[:0])


@pytest.mark.parametrize("name", ["", " a", "a ", "a\tb", "a\nb", "a\0", "\ud800", "a\u2028b", "\x85"])
def test_names_that_no_file_gives_back_are_refused(cubes, name):
    with pytest.raises(InputError, match="names must not be empty") as error:
        BlockSet(("a", name), cubes.dims[:2], cubes.com[:2], cubes.mass[:2])
    assert str(error.value).isprintable()


def test_the_first_impossible_block_is_named(cubes):
    names, dims, mass = list("abcdef"), cubes.dims.copy(), cubes.mass.copy()
    mass[4], dims[3, 1], names[5] = -1, 0, "a"
    with pytest.raises(InputError, match="block d: dim_x"):
        BlockSet(tuple(names), dims, cubes.com, mass)
    dims[3, 1] = 1
    with pytest.raises(InputError, match="block e: mass"):
        BlockSet(tuple(names), dims, cubes.com, mass)
    mass[4] = 1
    with pytest.raises(InputError, match="block a: the name stands twice"):
        BlockSet(tuple(names), dims, cubes.com, mass)


def test_large_sets_turn_blocks_as_small_ones_do():
    """Above `TABLE` blocks no table of all rotations is kept; every bit, the sign of zeros too, is the same."""
    large = BlockSource(blocks=TABLE + 1, seed=5).load()
    large.com[:, 0] = 0.0
    small = large.subset(np.arange(TABLE))
    block, rotation = np.divmod(np.arange(24 * 100), 24)
    for turn in ("dims_after", "com_after"):
        assert getattr(large, turn)(block, rotation).tobytes() == getattr(small, turn)(block, rotation).tobytes()
    assert "rotated_com" in vars(small)
    assert "rotated_com" not in vars(large)


def test_random_blocks_follow_the_published_distribution():
    blocks = BlockSource(blocks=4000, seed=5).load()
    share = blocks.com / blocks.dims
    for values, low, high in [(blocks.dims, 0.05, 0.15), (blocks.mass, 0.1, 1.0), (share, -0.45, 0.45)]:
        assert low <= values.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < values.max() <= high
        # uniform: mean in the middle, sd = range / sqrt(12); the mean of 4000 has an sd of 0.0046 ranges
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.02 * (high - low))
        assert values.std() == pytest.approx((high - low) / np.sqrt(12), rel=0.03)


def test_each_axis_is_drawn_by_itself():
    blocks = BlockSource(blocks=4000, seed=5).load()
    columns = np.column_stack([blocks.dims, blocks.com / blocks.dims, blocks.mass])
    correlation = np.corrcoef(columns, rowvar=False) - np.eye(7)
    assert np.abs(correlation).max() < 0.08  # 5 sd of 1 / sqrt(4000)


def test_a_seed_fixes_the_blocks():
    first, again, other = (BlockSource(blocks=5, seed=seed).load() for seed in (1, 1, 2))
    assert first.dims.tobytes() == again.dims.tobytes()
    assert first.com.tobytes() == again.com.tobytes()
    assert first.mass.tobytes() == again.mass.tobytes()
    assert not np.array_equal(first.dims, other.dims)


def test_names_are_numbered_with_the_prefix():
    assert BlockSource(blocks=2, prefix="wood").load().name == ("wood_00", "wood_01")


def test_a_file_takes_the_place_of_random_blocks(tmp_path, blocks):
    write_blocks(blocks, tmp_path / "mine.csv")
    loaded = BlockSource(blocks=2, file=tmp_path / "mine.csv").load()
    assert loaded.name == blocks.name
    assert loaded.dims.tobytes() == blocks.dims.tobytes()


def test_a_file_of_more_blocks_than_towers_are_drawn_from(tmp_path, cubes):
    n = MOST + 1
    many = BlockSet(tuple(map(str, range(n))), *(np.repeat(v[:1], n, 0) for v in (cubes.dims, cubes.com, cubes.mass)))
    write_blocks(many, tmp_path / "many.parquet")
    with pytest.raises(InputError, match=r"many\.parquet: 32768 blocks; towers are drawn from at most 32767"):
        BlockSource(file=tmp_path / "many.parquet").load()


@pytest.mark.parametrize(
    "wrong", [{"blocks": 0}, {"seed": -1}, {"side": (0.0, 0.1)}, {"mass": (-1.0, 1.0)}, {"com_share": 1.0}, {"blox": 3}]
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        BlockSource(**wrong)


@pytest.mark.parametrize("wrong", [{"side": (0.15, 0.05)}, {"mass": (1.0, 0.1)}])
def test_a_range_from_high_to_low_is_refused(wrong):
    with pytest.raises((ValidationError, InputError), match=next(iter(wrong))):
        BlockSource(**wrong).load()
