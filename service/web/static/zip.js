// ZIP archives, and files that the browser saves.

import { make } from "./dom.js";

/** The most files, and bytes, of an archive without the extension for larger ones. */
const MOST_FILES = 65_535, MOST_BYTES = 2 ** 32 - 1;
const UTF8 = 0x800, DEFLATED = 8, VERSION = 20;
/** The first of January 1980, the least date. */
const DATE = 0x21;

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? 0xedb88320 ^ (value >>> 1) : value >>> 1;
  return value;
});

/** @param {Uint8Array} data */
function crc32(data) {
  let value = -1;
  for (const byte of data) value = TABLE[(value ^ byte) & 0xff] ^ (value >>> 8);
  return ~value >>> 0;
}

/** Numbers of two or of four bytes, little-endian. @param {[number, 2 | 4][]} fields */
function record(fields) {
  const view = new DataView(new ArrayBuffer(fields.reduce((sum, [, size]) => sum + size, 0)));
  let place = 0;
  for (const [value, size] of fields) {
    if (size === 2) view.setUint16(place, value, true);
    else view.setUint32(place, value, true);
    place += size;
  }
  return new Uint8Array(view.buffer);
}

/**
 * An archive of compressed files.
 * @param {{ name: string, data: ArrayBuffer }[]} files With different names.
 */
export async function zip(files) {
  /** @type {BlobPart[]} */
  const parts = [], directory = [];
  let place = 0, directoryBytes = 0;
  for (const { name, data } of files) {
    const path = new TextEncoder().encode(name);
    const packed = await new Response(new Blob([data]).stream().pipeThrough(new CompressionStream("deflate-raw"))).arrayBuffer();
    /** @type {[number, 2 | 4][]} */
    const about = [
      [VERSION, 2], [UTF8, 2], [DEFLATED, 2], [0, 2], [DATE, 2], [crc32(new Uint8Array(data)), 4],
      [packed.byteLength, 4], [data.byteLength, 4], [path.length, 2], [0, 2],
    ];
    const head = record([[0x04034b50, 4], ...about]);
    const entry = record([[0x02014b50, 4], [VERSION, 2], ...about, [0, 2], [0, 2], [0, 2], [0, 4], [place, 4]]);
    parts.push(head, path, packed);
    directory.push(entry, path);
    place += head.length + path.length + packed.byteLength;
    directoryBytes += entry.length + path.length;
    if (files.length > MOST_FILES || place > MOST_BYTES) throw new Error("These are too many files for one archive.");
  }
  const end = record([
    [0x06054b50, 4], [0, 2], [0, 2], [files.length, 2], [files.length, 2], [directoryBytes, 4], [place, 4], [0, 2],
  ]);
  return new Blob([...parts, ...directory, end], { type: "application/zip" });
}

/** Have the browser save a file. @param {string} name @param {Blob} data */
export function save(name, data) {
  const href = URL.createObjectURL(data);
  make("a", { href, download: name }).click();
  // Until the browser has begun to save it.
  setTimeout(() => URL.revokeObjectURL(href), 10_000);
}
