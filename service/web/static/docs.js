// The OpenAPI document by Swagger UI, which is a classic script and leaves its function on the window.

/** @typedef {(options: Record<string, unknown>) => void} SwaggerUI */

const { SwaggerUIBundle } = /** @type {{ SwaggerUIBundle: SwaggerUI }} */ (/** @type {unknown} */ (window));

SwaggerUIBundle({ url: "openapi.json", dom_id: "#documentation", deepLinking: true, validatorUrl: null });

