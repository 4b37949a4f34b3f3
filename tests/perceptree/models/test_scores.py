"""Scores of boxes joined with those of their masks."""

import torch

from perceptree.models.scores import (
    MOST_CERTAIN,
    highest_scores,
    joint_scores,
    mask_certainty,
)


def test_the_certainty_of_a_mask_is_the_mean_of_the_cells_that_show_the_stem() -> None:
    masks = torch.zeros(3, 28, 28)
    masks[0, 3:9, 5] = 0.9
    masks[0, 3:9, 6] = 0.7
    masks[0, 3:9, 7] = 0.4
    masks[1] = 0.49
    masks[2] = 1.0
    torch.testing.assert_close(mask_certainty(masks), torch.tensor([0.8, 0.5, 1.0]))


def test_a_certain_mask_multiplies_the_odds_of_a_tree() -> None:
    scores = torch.tensor([0.5, 0.5, 0.2, 1.0, 0.0])
    certainty = torch.tensor([0.5, 0.8, 0.9, 0.9, 0.9])
    # Odds of masks 1, 4, 9, 9, 9; their roots are 1, 2, 3, 3, 3.
    found = joint_scores(scores, certainty, 0.5)
    torch.testing.assert_close(found, torch.tensor([0.5, 2 / 3, 3 / 7, 1.0, 0.0]))


def test_no_mask_raises_a_score_further_than_the_most_certain_one() -> None:
    scores = torch.linspace(0.0, 1.0, 21)
    highest = highest_scores(scores, 0.7)
    for certainty in (0.5, 0.9, MOST_CERTAIN, 1.0):
        assert (joint_scores(scores, torch.tensor(certainty), 0.7) <= highest + 1e-6).all()
    torch.testing.assert_close(joint_scores(scores, torch.tensor(MOST_CERTAIN), 0.7), highest)
    assert (highest[1:-1] > scores[1:-1]).all()
