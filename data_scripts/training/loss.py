"""Which cells learn which box, and how wrong their predictions are.

Cells are assigned by what they already predict (task-aligned assignment; Feng et al., TOOD, ICCV 2021): for
each box those candidates inside it with the largest score^a · IoU^b. The score they shall give is their
quality relative to the box's best cell, so that score and overlap agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

SCORE_POWER, OVERLAP_POWER = 0.5, 6.0
EPS = 1e-7


@dataclass(frozen=True)
class Truth:
    """Boxes of one picture: corners (K, 4) pixels, class_id (K,), ignored (M, 4)."""

    corners: Tensor
    class_id: Tensor
    ignored: Tensor


@dataclass(frozen=True)
class Assignment:
    """What the N cells of one picture shall predict.

    Attributes
    ----------
    box : (N,) box learnt, -1 for none.
    score : (N, C) class scores.
    counts : (N,) whether the class loss counts here; not on ignored vehicles.
    """

    box: Tensor
    score: Tensor
    counts: Tensor


def overlap(a: Tensor, b: Tensor) -> Tensor:
    """IoU of boxes (..., 4) and (..., 4), corners."""
    low, high = torch.maximum(a[..., :2], b[..., :2]), torch.minimum(a[..., 2:], b[..., 2:])
    both = (high - low).clamp(min=0).prod(-1)
    area_a, area_b = ((x[..., 2:] - x[..., :2]).clamp(min=0).prod(-1) for x in (a, b))
    return both / (area_a + area_b - both + EPS)


def complete_overlap(a: Tensor, b: Tensor) -> Tensor:
    """IoU less a term for the distance of the centres and one for the aspect (CIoU; Zheng et al., 2020)."""
    iou = overlap(a, b)
    low, high = torch.minimum(a[..., :2], b[..., :2]), torch.maximum(a[..., 2:], b[..., 2:])
    diagonal = (high - low).square().sum(-1) + EPS
    apart = (a[..., :2] + a[..., 2:] - b[..., :2] - b[..., 2:]).square().sum(-1) / 4
    size_a, size_b = a[..., 2:] - a[..., :2], b[..., 2:] - b[..., :2]
    angle = torch.atan(size_b[..., 0] / (size_b[..., 1] + EPS)) - torch.atan(
        size_a[..., 0] / (size_a[..., 1] + EPS)
    )
    aspect = 4 / math.pi**2 * angle.square()
    with torch.no_grad():
        weight = aspect / (1 - iou + aspect + EPS)
    return iou - apart / diagonal - weight * aspect


def inside(cells: Tensor, boxes: Tensor) -> Tensor:
    """Whether cell centres (N, 3) lie in boxes (K, 4): (K, N) bool."""
    x, y = cells[:, 0], cells[:, 1]
    return (x > boxes[:, :1]) & (y > boxes[:, 1:2]) & (x < boxes[:, 2:3]) & (y < boxes[:, 3:4])


@torch.no_grad()
def assign(corners: Tensor, scores: Tensor, cells: Tensor, truth: Truth, candidates: int) -> Assignment:
    """Assign cells to the boxes of one picture.

    Parameters
    ----------
    corners, scores : (N, 4) and (N, C) predictions. cells : (N, 3) centre and stride.
    candidates : cells a box gets at most.
    """
    count = len(cells)
    box = torch.full((count,), -1, dtype=torch.long)
    wanted = torch.zeros_like(scores)
    counts = ~inside(cells, truth.ignored).any(0)
    if not len(truth.corners):
        return Assignment(box, wanted, counts)
    # A box too small to hold a centre is given those of the finest cells nearest to its own.
    middle = 0.5 * (truth.corners[:, :2] + truth.corners[:, 2:])
    half = (0.5 * (truth.corners[:, 2:] - truth.corners[:, :2])).clamp(min=0.75 * float(cells[:, 2].min()))
    allowed = inside(cells, torch.cat([middle - half, middle + half], 1))
    iou = overlap(truth.corners[:, None], corners[None]) * allowed
    quality = scores.T[truth.class_id].clamp(min=1e-6) ** SCORE_POWER * iou**OVERLAP_POWER
    best, place = quality.topk(min(candidates, count), dim=1)
    chosen = torch.zeros_like(quality).scatter_(1, place, (best > 0).to(quality.dtype)) > 0
    # A cell wanted by several boxes takes the one it overlaps most.
    taken = chosen.any(0)
    box[taken] = torch.where(chosen, iou, -1.0).argmax(0)[taken]
    mine = chosen & (box[None] == torch.arange(len(truth.corners))[:, None])
    quality, iou = quality * mine, iou * mine
    share = quality / (quality.amax(1, keepdim=True) + 1e-12) * iou.amax(1, keepdim=True)
    cell = torch.nonzero(taken).flatten()
    wanted[cell, truth.class_id[box[cell]]] = share[box[cell], cell]
    return Assignment(box, wanted, counts | taken)


def detection_loss(
    corners: Tensor, logits: Tensor, cells: Tensor, truths: list[Truth], box_weight: float, candidates: int
) -> tuple[Tensor, Tensor]:
    """Box and class loss of a batch: (B, N, 4) and (B, N, C) predictions, one truth a picture.

    Both are sums divided by the sum of the wanted scores; the box loss 1 - CIoU is weighted by them too.
    """
    scores = logits.detach().sigmoid()
    box_loss, class_loss, total = corners.sum() * 0.0, logits.sum() * 0.0, 0.0
    for b, truth in enumerate(truths):
        found = assign(corners[b].detach(), scores[b], cells, truth, candidates)
        each = F.binary_cross_entropy_with_logits(logits[b], found.score, reduction="none").sum(-1)
        class_loss = class_loss + (each * found.counts).sum()
        cell = torch.nonzero(found.box >= 0).flatten()
        if len(cell):
            weight = found.score[cell].sum(-1)
            good = complete_overlap(corners[b, cell], truth.corners[found.box[cell]])
            box_loss = box_loss + ((1 - good) * weight).sum()
            total += float(weight.sum())
    scale = 1.0 / max(total, 1.0)
    return box_weight * scale * box_loss, scale * class_loss
