// The main page: signs in, then shows the view of the address.

import { collection, collections, session, signedOut, signIn, signOut, version } from "./api.js";
import { openDeleted } from "./deleted.js";
import { byId, make, showError } from "./dom.js";
import { allowDeletions, openDuplicates } from "./duplicates.js";
import { findFile, openFind } from "./find.js";
import { allowChanges, openGallery, reload } from "./gallery.js";
import { openLibrary } from "./library.js";
import { openMap } from "./map.js";
import { allowPaths } from "./paths.js";
import { forget, openSelection } from "./selection.js";
import { current, go, linkTo, moved, opensElsewhere } from "./state.js";
import "./tags.js";
import { openJobs, store } from "./upload.js";

/** @import { State } from "./state.js" */
/** @import { Session } from "./types.js" */

const ASK_MILLISECONDS = 1000;

const starting = byId("starting", HTMLElement);

/** The reason why the service is not ready, or null. */
async function reason() {
  try {
    const answer = await fetch("readyz");
    // Read also when it is not needed: an answer that is not stored by the browser stays open until it is read.
    const { detail } = await answer.json();
    return answer.ok ? null : detail;
  } catch {
    return "it does not answer";
  }
}

/** Shows the reason until the service is ready; resolves then, with whether it had to wait. */
async function ready() {
  for (let waited = false; ; waited = true) {
    const told = await reason();
    starting.hidden = told === null;
    if (told === null) return waited;
    starting.textContent = `The service starts: ${told}.`;
    await new Promise((resolve) => setTimeout(resolve, ASK_MILLISECONDS));
  }
}

const collectionForm = byId("collections", HTMLFormElement);
const choice = byId("collection", HTMLSelectElement);

/** The address of the view in another collection. @param {string} name */
const addressOf = (name) => {
  const { view } = current();
  return `${location.pathname}?${new URLSearchParams({ view, collection: name })}`;
};

/** Show the collections; true if the page reloads for the first of them, because there is no default one. */
async function openCollections() {
  const known = await collections();
  const names = known.map(({ name }) => name);
  if (!collection && names.length > 1 && !names.includes("default")) {
    location.replace(addressOf(names[0]));
    return true;
  }
  choice.replaceChildren(...known.map(({ name, shapes }) => make(
    "option", { value: name, selected: name === (collection || "default") }, `${name} (${shapes})`,
  )));
  collectionForm.hidden = names.length < 2;
  return false;
}

choice.addEventListener("change", () => location.assign(addressOf(choice.value)));
collectionForm.addEventListener("submit", (event) => event.preventDefault());

/** @param {(files: File[]) => void} take */
function dropAnywhere(take) {
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

const form = byId("sign-in", HTMLElement);
const content = byId("signed-in", HTMLElement);
const key = byId("key", HTMLInputElement);
const views = byId("views", HTMLElement);
const site = byId("site", HTMLElement);
const signOutButton = byId("sign-out", HTMLButtonElement);
const errorBox = byId("error", HTMLElement);

/** @type {Record<string, (state: State) => void>} */
const OPEN = { find: openFind, browse: openGallery, map: openMap, duplicates: openDuplicates, library: openLibrary, upload: () => {} };

/** The last state of each view, to which its link leads back. @type {Record<string, State>} */
const left = {};

/** Let the choice of files show the formats that the service reads. */
async function offerFormats() {
  const endings = (await version()).formats.flatMap((format) => (format.read ? format.endings : []));
  for (const id of ["find-file", "upload-files"]) {
    const input = byId(id, HTMLInputElement);
    input.accept = [...endings.map((ending) => `.${ending}`), input.dataset.archives ?? ""].join();
  }
}

/** Show the page once all of it knows what the key allows. @param {Session} own */
async function enter(own) {
  const full = own.access === "full";
  if (own.access === "none") {
    form.hidden = false;
    return key.focus();
  }
  // Until there is an answer, the choice shows all files.
  offerFormats().catch((error) => showError(errorBox, error));
  if (await openCollections()) return;
  allowChanges(full);
  allowDeletions(full);
  allowPaths(full);
  // First, because the deletion dialog says how long a shape can be restored.
  if (full) {
    await openDeleted(() => {
      forget();
      if (shownView() === "duplicates") show();
      else reload();
    });
  }
  for (const part of document.querySelectorAll("[data-needs=full]")) {
    /** @type {HTMLElement} */ (part).hidden = !full;
  }
  openSelection(reload);
  form.hidden = true;
  content.hidden = views.hidden = false;
  signOutButton.hidden = !own.signed_in;
  moved.addEventListener("moved", show);
  show();
  if (full) openJobs().catch((error) => showError(errorBox, error));
}

/** The view of the address, or the first one. */
function shownView() {
  const { view } = current();
  const link = document.querySelector(`nav a[data-view="${CSS.escape(view)}"]`);
  return link instanceof HTMLElement && !link.hidden ? view : "find";
}

/** Show the view of the address. */
function show() {
  const view = shownView();
  const state = current();
  left[view] = state;
  for (const part of content.querySelectorAll(":scope > section")) {
    /** @type {HTMLElement} */ (part).hidden = part.id !== `view-${view}`;
  }
  for (const link of /** @type {NodeListOf<HTMLAnchorElement>} */ (document.querySelectorAll("nav a[data-view]"))) {
    const own = link.dataset.view ?? "";
    link.href = linkTo(own, left[own]?.parameters);
    if (own === view) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  OPEN[view](state);
}

async function begin() {
  try {
    await enter(await session());
    showError(errorBox);
  } catch (error) {
    showError(errorBox, error);
  }
}

byId("sign-in-form", HTMLFormElement).addEventListener("submit", async (event) => {
  event.preventDefault();
  const place = byId("sign-in-error", HTMLElement);
  try {
    const own = await signIn(key.value.trim());
    key.value = "";
    showError(place);
    await enter(own);
    // A scroll would close a menu that is open by now.
    byId("main", HTMLElement).focus({ preventScroll: true });
  } catch (error) {
    showError(place, error);
  }
});
signOutButton.addEventListener("click", async () => {
  await signOut();
  // Removes all data from the page.
  location.reload();
});
signedOut.addEventListener("signed-out", () => {
  form.hidden = false;
  content.hidden = views.hidden = true;
  signOutButton.hidden = true;
});
document.addEventListener("click", (event) => {
  const link = event.target instanceof Element ? event.target.closest("a[data-view]") : null;
  if (!(link instanceof HTMLAnchorElement) || opensElsewhere(event)) return;
  event.preventDefault();
  const view = link.dataset.view ?? "find";
  const parameters = new URL(link.href).searchParams;
  for (const name of ["view", "collection"]) parameters.delete(name);
  site.togglePopover(false);
  go(view, parameters, views.contains(link) ? left[view]?.file : null);
  scrollTo(0, 0);
});
dropAnywhere((files) => {
  if (content.hidden) return;
  if (shownView() === "upload") store(files);
  else findFile(files);
});
const started = ready();
await begin();
// The shapes of a service that has just become ready are shown anew.
if ((await started) && !content.hidden) show();
