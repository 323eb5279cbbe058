// Files that are dropped anywhere on the page.

/** @param {(files: File[]) => void} take */
export function dropAnywhere(take) {
  const { classList } = document.documentElement;
  addEventListener("dragover", (event) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    classList.add("over");
  });
  addEventListener("dragleave", (event) => {
    // Without a related element, the pointer has left the window.
    if (event.relatedTarget === null) classList.remove("over");
  });
  addEventListener("drop", (event) => {
    const files = [...(event.dataTransfer?.files ?? [])];
    classList.remove("over");
    if (files.length === 0) return;
    event.preventDefault();
    take(files);
  });
}
