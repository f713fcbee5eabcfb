import { defineConfig } from "vite";
import { viteSingleFile } from "vite-plugin-singlefile";

// One file with everything inside, beside the Python module that fills it.
export default defineConfig({
  plugins: [viteSingleFile()],
  build: {
    target: "es2022",
    outDir: "../python/holonom/view",
    emptyOutDir: false,
    rolldownOptions: { input: "page.html" },
  },
});
