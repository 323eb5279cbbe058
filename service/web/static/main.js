// The main page: signs in, then opens all sections.

import { session, signIn, signOut, signedOut } from "./api.js";
import { openCollections } from "./collections.js";
import { byId, showError } from "./dom.js";
import { openDeleted } from "./deleted.js";
import { openGallery, reload } from "./gallery.js";
import { openJobs } from "./jobs.js";
import "./upload.js";

/** @import { Session } from "./types.js" */

const form = byId("sign-in", HTMLElement);
const content = byId("signed-in", HTMLElement);
const key = byId("key", HTMLInputElement);
const signOutButton = byId("sign-out", HTMLButtonElement);
const errorBox = byId("error", HTMLElement);

/** @param {Session} own */
async function enter(own) {
  const may = own.access !== "none";
  form.hidden = may;
  content.hidden = !may;
  signOutButton.hidden = !own.signed_in;
  for (const part of document.querySelectorAll("[data-needs=full]")) {
    /** @type {HTMLElement} */ (part).hidden = own.access !== "full";
  }
  if (!may) return key.focus();
  if (await openCollections()) return;
  const full = own.access === "full";
  // First, because the deletion dialog says how long a shape can be restored.
  if (full) await openDeleted(reload);
  await openGallery(full);
  if (full) await openJobs();
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
    byId("main", HTMLElement).focus();
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
  content.hidden = true;
  signOutButton.hidden = true;
});
begin();
