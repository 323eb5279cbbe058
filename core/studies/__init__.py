"""The paper's experiments and ours: meshes and settings in, perturbed meshes, trials and figures out."""

__all__ = ["ablation", "correspondence", "perturbation", "published_figures", "robustness"]
