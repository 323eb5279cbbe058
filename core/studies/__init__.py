"""The paper's experiments and ours: meshes and parameters in; perturbed meshes, trials and figures out."""

__all__ = ["ablation", "correspondence", "perturbation", "published_figures", "robustness"]
