/** Makes src/protocol.gen.ts and src/trainer.gen.ts, the types of what pages and server say, from their schemas. */

import { readFile, writeFile } from "node:fs/promises";
import { compile } from "json-schema-to-typescript";

const HERE = new URL("./", import.meta.url);
const SAID = [
  ["protocol", "Protocol", "server"],
  ["trainer", "TrainerProtocol", "course"],
];

/** A tuple as the generator knows it: `prefixItems` came after the drafts it reads. */
function asItems(schema) {
  if (Array.isArray(schema)) return schema.map(asItems);
  if (schema === null || typeof schema !== "object") return schema;
  const { prefixItems, ...rest } = Object.fromEntries(Object.entries(schema).map(([key, value]) => [key, asItems(value)]));
  return prefixItems ? { ...rest, items: prefixItems } : rest;
}

for (const [file, name, room] of SAID) {
  const schema = asItems(JSON.parse(await readFile(new URL(`${file}.schema.json`, HERE), "utf8")));
  const bannerComment = `/** Made of ${file}.schema.json by generate.mjs: change the messages in src/sonospline/${room} instead. */`;
  const types = await compile(schema, name, { bannerComment, additionalProperties: false, format: false });
  await writeFile(new URL(`src/${file}.gen.ts`, HERE), types);
}
