// Asking the service. Addresses are relative to its root, wherever a proxy puts that.

/** @import { Session } from "./types.js" */

const ROOT = new URL("../", import.meta.url);

/** The collection that the page works in, if it is told one: by its address, or by the service. */
export const collection = new URLSearchParams(location.search).get("collection")
  || document.getElementById("main")?.dataset.collection || "";

/** The service's answer that something went wrong, in its own words. */
export class ProblemError extends Error {
  /**
   * @param {number} status
   * @param {string} text The body: a problem document, or whatever a proxy writes.
   */
  constructor(status, text) {
    let message = `The service answered ${status}.`;
    try {
      const { title, detail } = JSON.parse(text);
      if (title) message = detail && detail !== title ? `${title}: ${detail}` : title;
    } catch {
      // Not the service's own words.
    }
    super(message);
    this.status = status;
  }
}

/** Told when the service wants a key. */
export const signedOut = new EventTarget();

/**
 * The address of something at the service, in the page's collection.
 * @param {string} path
 * @param {Record<string, string | string[]>} [parameters]
 */
export function address(path, parameters = {}) {
  const url = new URL(path, ROOT);
  for (const [name, value] of Object.entries({ ...parameters, collection })) {
    for (const each of [value].flat()) if (each !== "") url.searchParams.append(name, each);
  }
  return url.href;
}

/**
 * @param {string} url
 * @param {RequestInit} [init]
 */
export async function ask(url, init) {
  let response;
  try {
    response = await fetch(url, { credentials: "same-origin", ...init });
  } catch (error) {
    if (init?.signal?.aborted) throw error;
    throw new Error("The service does not answer.");
  }
  if (!response.ok) {
    const problem = new ProblemError(response.status, await response.text());
    if (response.status === 401) signedOut.dispatchEvent(new Event("signed-out"));
    throw problem;
  }
  return response;
}

/**
 * @param {string} url
 * @param {unknown} value
 * @param {AbortSignal} [signal]
 */
export async function askWith(url, value, signal) {
  const headers = { "Content-Type": "application/json" };
  return (await ask(url, { method: "POST", headers, body: JSON.stringify(value), signal })).json();
}

/**
 * Send a form, telling how much of it has gone; `fetch` cannot tell that.
 * @param {string} url
 * @param {FormData} form
 * @param {(share: number) => void} progress Told a number from 0 to 1.
 * @param {AbortSignal} [signal]
 * @returns {Promise<{ status: number, body: any }>}
 */
export function send(url, form, progress, signal) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.upload.addEventListener("progress", (event) => {
      if (event.lengthComputable) progress(event.loaded / event.total);
    });
    request.addEventListener("load", () => {
      if (request.status >= 200 && request.status < 300) {
        resolve({ status: request.status, body: JSON.parse(request.responseText) });
      } else {
        if (request.status === 401) signedOut.dispatchEvent(new Event("signed-out"));
        reject(new ProblemError(request.status, request.responseText));
      }
    });
    request.addEventListener("error", () => reject(new Error("The service does not answer.")));
    request.addEventListener("abort", () => reject(new DOMException("stopped", "AbortError")));
    signal?.addEventListener("abort", () => request.abort());
    request.open("POST", url);
    request.send(form);
  });
}

/** @returns {Promise<Session>} */
export async function session() {
  return (await ask(address("session"))).json();
}

/**
 * Trade a key for a cookie.
 * @param {string} key
 * @returns {Promise<Session>}
 */
export async function signIn(key) {
  // A header takes no other characters, and no key has them.
  if (!/^[\x21-\x7e]+$/.test(key)) throw new Error("That is no key of this service.");
  return (await ask(address("session"), { method: "POST", headers: { "X-API-Key": key } })).json();
}

/** End the session. */
export const signOut = () => ask(address("session"), { method: "DELETE" });
