// Files that are dropped on the page or chosen in a dialogue.

import { post, Refused } from "./api";
import { h } from "./dom";

/** As the server takes them. */
const MOST_BYTES = 150 * 2 ** 20;

async function send(files: FileList | File[], beside: string | null): Promise<string> {
  const list = [...files];
  const bytes = list.reduce((sum, file) => sum + file.size, 0);
  if (bytes > MOST_BYTES) {
    throw new Refused(413, {
      problem: `The files are too large: ${Math.round(bytes / 2 ** 20)} MB, at most 150 MB. Give their folder to \`retina view\` instead.`,
    });
  }
  const texts = await Promise.all(list.map(async (file) => ({ name: file.name, text: await file.text() })));
  return (await post<{ id: string }>("/api/sessions/drop", { files: texts, beside })).id;
}

/** Takes files anywhere on the page. Gives back what undoes it. */
export function takeDrops(beside: () => string | null, open: (id: string) => void, failed: (e: unknown) => void): () => void {
  const over = (event: DragEvent): void => {
    if (event.dataTransfer?.types.includes("Files")) {
      event.preventDefault();
      document.body.classList.add("dropping");
    }
  };
  const leave = (): void => document.body.classList.remove("dropping");
  const drop = (event: DragEvent): void => {
    event.preventDefault();
    leave();
    if (event.dataTransfer && event.dataTransfer.files.length > 0) {
      send(event.dataTransfer.files, beside()).then(open, failed);
    }
  };
  document.addEventListener("dragover", over);
  document.addEventListener("dragleave", leave);
  document.addEventListener("drop", drop);
  return () => {
    document.removeEventListener("dragover", over);
    document.removeEventListener("dragleave", leave);
    document.removeEventListener("drop", drop);
  };
}

/** A button that opens the browser's dialogue for files. */
export function chooser(label: string, beside: () => string | null, open: (id: string) => void, failed: (e: unknown) => void): HTMLElement {
  const input = h("input", { type: "file", multiple: true, accept: ".csv,.toml", class: "unseen", tabindex: -1, "aria-hidden": "true" });
  input.addEventListener("change", () => {
    if (input.files && input.files.length > 0) {
      send(input.files, beside()).then(open, failed);
      input.value = "";
    }
  });
  return h("span", {}, h("button", { type: "button", "data-key": "choose", click: () => input.click() }, label), input);
}
