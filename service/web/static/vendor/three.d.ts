// The types of what vendor/three.js bundles, for the type checker.
export * from "three";
