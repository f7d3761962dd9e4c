// Answers and refusals for people: dated by the local clock, and gone after some seconds.

// A refusal has to be read; that all went well, only seen [ms].
const LASTS_MS = { yes: 8000, no: 15000 };
const FADES_MS = 1500;
const MOST = 4;

export const clock = (date) => [date.getHours(), date.getMinutes(), date.getSeconds()]
  .map((part) => String(part).padStart(2, "0")).join(":");

// Long names of files may be broken behind a part, and nowhere else.
export function write(element, text) {
  if (element.said === text) return;
  element.said = text;
  const parts = String(text).split(/(?<=[/_])/);
  element.replaceChildren(...parts.flatMap((part, index) => (index ? [document.createElement("wbr"), part] : [part])));
}

export function line(words, done, at) {
  const item = document.createElement("li");
  const time = document.createElement("time");
  time.textContent = clock(at);
  const text = document.createElement("span");
  write(text, words);
  item.append(time, text);
  if (!done) item.className = "no";
  return item;
}

export class Said {
  constructor(list) { this.list = list; }

  add(done, words) {
    const item = line(words, done, new Date());
    this.list.prepend(item);
    while (this.list.children.length > MOST) this.list.lastChild.remove();
    const lasts = done ? LASTS_MS.yes : LASTS_MS.no;
    setTimeout(() => item.classList.add("fades"), lasts - FADES_MS);
    setTimeout(() => item.remove(), lasts);
  }
}
