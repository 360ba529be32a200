import { defineConfig } from "vite";

// Names without hashes: the program names each file, and the server lets none be kept.
export default defineConfig({
  base: "/",
  build: {
    target: "es2022",
    modulePreload: false,
    rolldownOptions: {
      output: { entryFileNames: "view.js", assetFileNames: "view.[ext]" },
    },
  },
});
