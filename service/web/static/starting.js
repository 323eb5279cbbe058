// Says what the service is doing until it is ready: at its first start it compiles for a minute or more.

import { byId } from "./dom.js";

const ASK_MILLISECONDS = 1000;

const place = byId("starting", HTMLElement);

/** The reason why the service is not ready, or null. */
async function reason() {
  try {
    const answer = await fetch("readyz");
    return answer.ok ? null : (await answer.json()).detail;
  } catch {
    return "it does not answer";
  }
}

/** Shows the reason until the service is ready; resolves then, with whether it had to wait. */
export async function ready() {
  for (let waited = false; ; waited = true) {
    const told = await reason();
    place.hidden = told === null;
    if (told === null) return waited;
    place.textContent = `The service starts: ${told}.`;
    await new Promise((resolve) => setTimeout(resolve, ASK_MILLISECONDS));
  }
}
