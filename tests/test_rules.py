"""Rules that call a plan feasible, on probabilities whose answers are known."""

import numpy as np
from table_rules import calls


def test_each_rule_on_plans_that_tell_them_apart() -> None:
    # [members, plans, actions after the first]
    probabilities = np.array(
        [
            [[0.9, 0.9], [0.6, 0.7], [0.2, 0.9], [0.9, 0.3]],
            [[0.9, 0.9], [0.6, 0.7], [0.2, 0.9], [0.9, 0.3]],
            [[0.9, 0.9], [0.1, 0.7], [0.2, 0.9], [0.9, 0.3]],
        ]
    )
    expected = {
        "product": [True, False, False, False],  # 0.81, 0.30, 0.18, 0.27
        "each action": [True, False, False, False],  # the second plan: 0.43 on average
        "votes": [True, True, False, False],  # two members of three
        "last action": [True, True, True, False],
        "ranking": [True, True, False, False],  # the better half
    }
    assert {rule: feasible.tolist() for rule, feasible in calls(probabilities).items()} == expected
