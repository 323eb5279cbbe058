// Types of the service's responses; openapi/openapi.json describes them.

/**
 * @typedef {{ vertices: number, faces: number, area: number, volume: number, closed: boolean,
 *             bounding_box: number[], file_box: number[] }} Facts
 * @typedef {{ facts: Facts, unit: string }} Mesh
 * @typedef {Mesh & { id: string, name: string, tags: string[], metadata: Record<string, unknown>, format: string,
 *                    bytes: number, sha256: string, created_at: string, updated_at: string }} Shape
 * @typedef {{ shapes: Shape[], total: number, next_cursor: string | null }} ShapePage
 * @typedef {{ families: { shapes: Shape[] }[], single: number, unknown: number }} Families
 * @typedef {{ value: string, count: number, least?: number, greatest?: number }} Count
 * @typedef {{ total: number, tags: Count[], distinct_tags: number, formats: Count[], lengths: Count[],
 *             collections: Count[] }} Facets
 * @typedef {{ key: string | null, value: unknown, share: number, shapes: { id: string, name: string }[] }} Suggestion
 * @typedef {{ suggestions: Suggestion[], known: boolean }} Suggestions
 * @typedef {{ sample: number, vertex: number, position: number[] }} Point
 * @typedef {{ first: Point, second: Point, distance: number, effective: boolean }} Pair
 * @typedef {{ cc: number, ssd: number, sim: number, combined: number, likeness: string, scale: number | null,
 *             transform: number[][] | null, difference: { text: string } | null,
 *             instances: { text: string } | null }} Scores
 * @typedef {Scores & { rank: number, shape: Shape, correspondence: Pair[], size_ratio: number | null,
 *                      part_distance: number | null }} Result
 * @typedef {{ name: string, eigenvalues: number[], coordinates: number[][] }} Spectrum
 * @typedef {{ positions: number[][], spectra: Spectrum[] }} Embedding
 * @typedef {{ query: Mesh, results: Result[], parts: Result[], ranked_by: string, matched: boolean,
 *             compared: number, stored: number, embedding: Embedding | null,
 *             milliseconds: Record<string, number>, warnings: string[] }} Answer
 * @typedef {Scores & { correspondence: Pair[] }} Comparison
 * @typedef {{ maps: number, transferred: { points: { position: number[], confidence: number }[] } }} Compared
 * @typedef {{ files: number, waiting: number, stored: number, present: number, refused: number,
 *             ignored: number }} Counts
 * @typedef {{ type: string, title: string, detail: string }} Cause
 * @typedef {{ id: string, state: string, archive: string, counts: Counts, remaining_seconds: number | null,
 *             problem: Cause | null, ended_at: string | null }} Job
 * @typedef {{ jobs: Job[] }} JobPage
 * @typedef {{ files: { path: string, problem: Cause | null }[], next_cursor: string | null }} JobFilePage
 * @typedef {{ id: string, name: string, deleted_at: string, gone_at: string }} DeletedShape
 * @typedef {{ shapes: DeletedShape[], total: number, undo_days: number, next_cursor: string | null }} DeletedPage
 * @typedef {{ shapes: { id: string, name: string, column: number, row: number }[], size: number, total: number,
 *             version: string }} ShapeMap
 * @typedef {{ shape: Shape, likeness: string, scale: number, cc: number, residual: number,
 *             difference: { text: string } | null, compared_with: string | null, decision: string | null,
 *             paths: string[] }} Duplicate
 * @typedef {{ groups: Duplicate[][], shapes: number, unjudged: number }} Duplicates
 * @typedef {{ id: string, groups: number, pairs: number, left: { reason: string }[] }} Decided
 * @typedef {{ id: string | null }} MergedShape
 * @typedef {{ id: string, action: string, decided_by: string | null, reason: string, decided_at: string,
 *             count: number, names: string[] }} Act
 * @typedef {{ acts: Act[] }} Acts
 * @typedef {{ left: { reason: string }[] }} Undone
 * @typedef {{ due: number, done: number, unread: Record<string, string> }} Scan
 * @typedef {{ id: string, name: string, path: string, state: string, detail: string | null, scan: Scan,
 *             counts: { present: number, missing: number, refused: number, unreadable: number },
 *             scanned_at: string | null }} Source
 * @typedef {{ path: string, state: string, shape_id: string | null, problem: Cause | null }} SourceFile
 * @typedef {{ files: SourceFile[], total: number }} SourceFilePage
 * @typedef {{ collections: { name: string, shapes: number }[] }} Collections
 * @typedef {{ access: "none" | "read" | "full", signed_in: boolean }} Session
 * @typedef {{ formats: { name: string, title: string, endings: string[], read: boolean, written: boolean }[] }} Version
 */

export {};
