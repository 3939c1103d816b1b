import { defineConfig } from "vite";

export default defineConfig({
  base: "./",
  build: {
    outDir: "../semmap/server/viewer",
    emptyOutDir: true,
    chunkSizeWarningLimit: 1300,
    rolldownOptions: { input: ["index.html", "query.html"] },
  },
});
