"""The paper's experiments and ours: meshes and parameters in; perturbed meshes, trials and figures out."""

__all__ = [
    "ablation",
    "correspondence",
    "correspondence_truth",
    "perturbation",
    "published_figures",
    "robustness",
]
