// The page: signing in, and then everything else.

import { session, signIn, signOut, signedOut } from "./api.js";
import { openCollections } from "./collections.js";
import { byId, showTrouble } from "./dom.js";
import { openDeleted } from "./deleted.js";
import { openGallery, reload } from "./gallery.js";
import { openJobs } from "./jobs.js";
import "./store.js";

/** @import { Session } from "./types.js" */

const form = byId("sign-in", HTMLElement);
const inside = byId("inside", HTMLElement);
const key = byId("key", HTMLInputElement);
const leave = byId("sign-out", HTMLButtonElement);
const trouble = byId("trouble", HTMLElement);

/** @param {Session} own */
async function enter(own) {
  const may = own.access !== "none";
  form.hidden = may;
  inside.hidden = !may;
  leave.hidden = !own.signed_in;
  for (const part of document.querySelectorAll("[data-needs=full]")) {
    /** @type {HTMLElement} */ (part).hidden = own.access !== "full";
  }
  if (!may) return key.focus();
  if (await openCollections()) return;
  const full = own.access === "full";
  // Before anything can be deleted: the question whether to says what becomes of a shape.
  if (full) await openDeleted(reload);
  await openGallery(full);
  if (full) await openJobs();
}

async function begin() {
  try {
    await enter(await session());
    showTrouble(trouble);
  } catch (error) {
    showTrouble(trouble, error);
  }
}

byId("sign-in-form", HTMLFormElement).addEventListener("submit", async (event) => {
  event.preventDefault();
  const place = byId("sign-in-trouble", HTMLElement);
  try {
    const own = await signIn(key.value.trim());
    key.value = "";
    showTrouble(place);
    await enter(own);
    byId("main", HTMLElement).focus();
  } catch (error) {
    showTrouble(place, error);
  }
});
leave.addEventListener("click", async () => {
  await signOut();
  // Nothing of what was shown stays in the page.
  location.reload();
});
signedOut.addEventListener("signed-out", () => {
  form.hidden = false;
  inside.hidden = true;
  leave.hidden = true;
});
begin();
