/** Makes src/protocol.gen.ts, the types of what page and server say, from the protocol's schema. */

import { readFile, writeFile } from "node:fs/promises";
import { compile } from "json-schema-to-typescript";

const HERE = new URL("./", import.meta.url);
const BANNER = "/** Made of protocol.schema.json by generate.mjs: change the messages in src/sonospline/server instead. */";

/** A tuple as the generator knows it: `prefixItems` came after the drafts it reads. */
function asItems(schema) {
  if (Array.isArray(schema)) return schema.map(asItems);
  if (schema === null || typeof schema !== "object") return schema;
  const { prefixItems, ...rest } = Object.fromEntries(Object.entries(schema).map(([key, value]) => [key, asItems(value)]));
  return prefixItems ? { ...rest, items: prefixItems } : rest;
}

const schema = asItems(JSON.parse(await readFile(new URL("protocol.schema.json", HERE), "utf8")));
const types = await compile(schema, "Protocol", { bannerComment: BANNER, additionalProperties: false, format: false });
await writeFile(new URL("src/protocol.gen.ts", HERE), types);
