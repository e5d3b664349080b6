import { defineConfig } from "vite";

// The page goes into the Python package: the wheel and `sonospline serve` take it from there.
// Nothing is inlined, so that a strict content security policy needs no exception.
export default defineConfig({
  base: "./",
  server: { host: "127.0.0.1" },
  build: {
    rollupOptions: { input: ["index.html", "trainer.html"] },
    outDir: "../src/sonospline/server/page",
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 900,
    reportCompressedSize: false,
  },
});
