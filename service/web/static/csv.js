// Tables as files of comma-separated values (RFC 4180).

import { make } from "./dom.js";

/** What spreadsheets evaluate, as in service/duplicates/schemas.py. */
const FORMULA = /^[=+\-@\t\r]/;

/** @param {string | number | null} value Text gets an apostrophe where a spreadsheet would take it for a formula. */
function cell(value) {
  const text = typeof value === "string" && FORMULA.test(value) ? `'${value}` : String(value ?? "");
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/**
 * Save a table as a file.
 * @param {string} name
 * @param {(string | number | null)[][]} rows The head first.
 */
export function saveTable(name, rows) {
  const text = rows.map((row) => `${row.map(cell).join(",")}\r\n`).join("");
  const href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  make("a", { href, download: name }).click();
  // Until the browser has begun to save it.
  setTimeout(() => URL.revokeObjectURL(href), 10_000);
}
