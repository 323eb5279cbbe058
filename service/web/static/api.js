// Requests to the service. Addresses are relative to its root, which a proxy may move.

/** @import { Collections, Session, Shape, Version } from "./types.js" */

const ROOT = new URL("../", import.meta.url);

/** The collection of the page, from its address or from the service; may be empty. */
export const collection = new URLSearchParams(location.search).get("collection")
  || document.getElementById("main")?.dataset.collection || "";

/** An error response of the service, with its message. */
export class ProblemError extends Error {
  /**
   * @param {number} status
   * @param {string} text The body: a problem document, or text of a proxy.
   */
  constructor(status, text) {
    let message = `The service responded with status ${status}.`;
    try {
      const { title, detail } = JSON.parse(text);
      if (title) message = detail && detail !== title ? `${title}: ${detail}` : title;
    } catch {
      // The body is not a problem document.
    }
    super(message);
    this.status = status;
  }
}

/** Receives an event when the service requires a key. */
export const signedOut = new EventTarget();

/**
 * The address of a resource, in the page's collection.
 * @param {string} path
 * @param {URLSearchParams | Record<string, string>} [parameters] Empty ones are left out.
 */
export function address(path, parameters = {}) {
  const url = new URL(path, ROOT);
  for (const [name, value] of [...new URLSearchParams(parameters), ["collection", collection]]) {
    if (value !== "") url.searchParams.append(name, value);
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
    throw new Error("The service does not respond.");
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

/** @param {string} id @returns {Promise<Shape>} */
export const readShape = async (id) => (await ask(address(`shapes/${id}`))).json();

/**
 * Change the given fields of a shape; resolves with the whole of it.
 * @param {string} id
 * @param {{ name?: string, tags?: string[], metadata?: Record<string, unknown>, collection?: string }} changes
 * @returns {Promise<Shape>}
 */
export async function changeShape(id, changes) {
  const headers = { "Content-Type": "application/json" };
  return (await ask(address(`shapes/${id}`), { method: "PATCH", headers, body: JSON.stringify(changes) })).json();
}

/**
 * A form with files and texts; empty texts are left out.
 * @param {Record<string, string | File>} fields
 */
export function formWith(fields) {
  const form = new FormData();
  for (const [name, value] of Object.entries(fields)) if (value !== "") form.append(name, value);
  return form;
}

/**
 * Send a form and report the progress of the upload, which `fetch` cannot.
 * @param {string} url
 * @param {FormData} form
 * @param {(share: number) => void} progress Called with a number from 0 to 1.
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
    request.addEventListener("error", () => reject(new Error("The service does not respond.")));
    request.addEventListener("abort", () => reject(new DOMException("stopped", "AbortError")));
    signal?.addEventListener("abort", () => request.abort());
    request.open("POST", url);
    request.send(form);
  });
}

/** The collections that the key may use. */
export async function collections() {
  /** @type {Collections} */
  const answer = await (await ask(address("collections"))).json();
  return answer.collections;
}

/** @returns {Promise<Version>} */
export async function version() {
  return (await ask(address("version"))).json();
}

/** @returns {Promise<Session>} */
export async function session() {
  return (await ask(address("session"))).json();
}

/**
 * Exchange a key for a session cookie.
 * @param {string} key
 * @returns {Promise<Session>}
 */
export async function signIn(key) {
  // Headers and keys have only these characters.
  if (!/^[\x21-\x7e]+$/.test(key)) throw new Error("This is not a valid key.");
  return (await ask(address("session"), { method: "POST", headers: { "X-API-Key": key } })).json();
}

/** End the session. */
export const signOut = () => ask(address("session"), { method: "DELETE" });
