// A list of any length: only the rows in view are elements. Browsers limit the height of elements, so that above
// that limit the scroll bar is scaled; wheel and keys still move by rows.

import { h } from "./dom";

/** Height of the scrolled element at most; Firefox ends at 17.8 million pixels. */
const MOST_HEIGHT = 8_000_000;

/** Rows per request. */
const PAGE = 100;

/** Pages kept. */
const MOST_PAGES = 60;

export interface Column<T> {
  title: string;
  name: string;
  cell(row: T): string;
}

export interface ListOptions<T> {
  label: string;
  columns: Column<T>[];
  fetch(from: number, count: number): Promise<T[]>;
  rowClass(row: T): string;
  /** The selected row changed by the user. */
  onSelect(row: T, index: number): void;
  onOpen(row: T, index: number): void;
  /** Moves after the moves before it. */
  inTurn?(move: () => void): void;
}

export class VirtualList<T> {
  readonly element: HTMLElement;
  private scroller: HTMLElement;
  private spacer: HTMLElement;
  private layer: HTMLElement;
  private rows: HTMLElement[] = [];
  private pages = new Map<number, T[]>();
  private asked = new Set<number>();
  private total = 0;
  private top = 0;
  private epoch = 0;
  /** How the cells are written. */
  private version = 0;
  private height = 24;
  private expected = 0;
  private drawn = false;
  private frame = 0;
  selected = -1;

  constructor(private options: ListOptions<T>) {
    this.layer = h("div", { class: "rows", role: "rowgroup" });
    this.spacer = h("div", { class: "spacer", "aria-hidden": "true" });
    this.scroller = h(
      "div",
      {
        class: "scroller",
        role: "grid",
        tabindex: 0,
        "aria-label": options.label,
        "aria-colcount": options.columns.length,
        onscroll: () => this.scrolled(),
        onkeydown: (event: KeyboardEvent) => this.key(event),
      },
      this.layer,
      this.spacer,
    );
    this.scroller.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    const heads = options.columns.map((column) =>
      h("span", { class: `cell ${column.name}`, role: "columnheader" }, column.title),
    );
    const head = h("div", { class: "head", "aria-hidden": "true" }, heads);
    this.element = h("div", { class: `list ${options.label.toLowerCase().replace(/\W+/g, "-")}` }, head, this.scroller);
    new ResizeObserver(() => this.draw()).observe(this.scroller);
  }

  focus(): void {
    this.scroller.focus({ preventScroll: true });
  }

  /** Shows `total` rows from the start of `index`. */
  reset(total: number, index = 0): void {
    this.epoch += 1;
    this.pages.clear();
    this.asked.clear();
    this.settle();
    this.total = total;
    this.selected = total > 0 ? Math.min(index, total - 1) : -1;
    this.scroller.setAttribute("aria-rowcount", String(total));
    this.resize();
    this.scrollTo(Math.max(0, this.selected - 5));
    this.draw();
  }

  private resize(): void {
    const probe = parseFloat(getComputedStyle(this.scroller).getPropertyValue("--row"));
    this.height = Number.isFinite(probe) && probe > 0 ? probe : 24;
    this.spacer.style.height = `${Math.min(this.total * this.height, MOST_HEIGHT)}px`;
  }

  private view(): number {
    return Math.max(1, this.scroller.clientHeight / this.height);
  }

  private last(): number {
    return Math.max(0, this.total - this.view());
  }

  /** Pixels of the scroll bar per row. */
  private scale(): number {
    const travel = Math.max(0, this.scroller.scrollHeight - this.scroller.clientHeight);
    return this.last() > 0 ? travel / this.last() : this.height;
  }

  private isScaled(): boolean {
    return this.total * this.height > MOST_HEIGHT;
  }

  private scrollTo(row: number): void {
    this.top = Math.min(Math.max(0, row), this.last());
    this.expected = Math.round(this.top * this.scale());
    this.scroller.scrollTop = this.expected;
    this.plan();
  }

  private scrolled(): void {
    const place = this.scroller.scrollTop;
    if (Math.abs(place - this.expected) < 1.5) return;
    const moved = place - this.expected;
    // A finger moves by pixels also where the bar is scaled.
    const isSmall = this.isScaled() && Math.abs(moved) < this.scroller.clientHeight / 3;
    if (isSmall) return this.scrollTo(this.top + moved / this.height);
    this.expected = place;
    this.top = Math.min(this.last(), place / Math.max(this.scale(), 1e-9));
    this.plan();
  }

  private wheel(event: WheelEvent): void {
    if (!this.isScaled() || event.ctrlKey) return;
    event.preventDefault();
    const unit = event.deltaMode === 1 ? 1 : event.deltaMode === 2 ? this.view() : 1 / this.height;
    this.scrollTo(this.top + event.deltaY * unit);
  }

  private key(event: KeyboardEvent): void {
    const page = Math.max(1, Math.floor(this.view()) - 1);
    const steps: Record<string, number> = {
      ArrowDown: 1, j: 1, ArrowUp: -1, k: -1, PageDown: page, PageUp: -page,
      Home: -Infinity, g: -Infinity, End: Infinity, G: Infinity,
    };
    const step = event.ctrlKey || event.metaKey || event.altKey ? undefined : steps[event.key];
    if (step !== undefined && this.total > 0) {
      event.preventDefault();
      event.stopPropagation();
      const move = () => {
        const to = step === Infinity ? this.total - 1 : step === -Infinity ? 0 : this.selected + step;
        this.select(Math.min(this.total - 1, Math.max(0, to)), true);
      };
      if (this.options.inTurn) this.options.inTurn(move);
      else move();
    } else if (event.key === "Enter" && this.selected >= 0) {
      const row = this.row(this.selected);
      if (row) this.options.onOpen(row, this.selected);
    }
  }

  /** Selects a row and shows it. */
  select(index: number, byUser = false): void {
    if (index < 0 || index >= this.total) return;
    this.selected = index;
    const view = Math.floor(this.view());
    if (index < this.top) this.scrollTo(index);
    else if (index > this.top + view - 1) this.scrollTo(index - view + 1);
    this.plan();
    if (byUser) this.tell();
  }

  /** Selects a row and shows it with rows before it. */
  reveal(index: number): void {
    if (index < 0 || index >= this.total) return;
    this.selected = index;
    const view = Math.floor(this.view());
    if (index < this.top || index > this.top + view - 1) this.scrollTo(index - Math.floor(view / 3));
    this.plan();
  }

  /** Paints all rows in view again. */
  repaint(): void {
    this.version += 1;
    this.plan();
  }

  /** Waits until the selected row is read. */
  async settled(): Promise<void> {
    if (this.pendingTell >= 0 && this.scroller.isConnected) await new Promise<void>((resolve) => this.waiting.push(resolve));
  }

  private tell(): void {
    const row = this.row(this.selected);
    this.pendingTell = row ? -1 : this.selected;
    if (row) this.options.onSelect(row, this.selected);
  }

  private settle(): void {
    this.pendingTell = -1;
    this.waiting.splice(0).forEach((resolve) => resolve());
  }

  /** Selected row, still to be read. */
  private pendingTell = -1;
  private waiting: (() => void)[] = [];

  row(index: number): T | undefined {
    return this.pages.get(Math.floor(index / PAGE))?.[index % PAGE];
  }

  private plan(): void {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  private draw(): void {
    // A hidden list reads nothing.
    if (!this.scroller.isConnected || this.scroller.clientHeight === 0) return this.settle();
    if (!this.drawn) {
      this.drawn = true;
      this.resize();
    }
    const count = Math.min(this.total, Math.ceil(this.view()) + 1);
    while (this.rows.length < count) this.rows.push(this.element1());
    this.layer.style.height = "0px";
    const first = Math.floor(this.top);
    const offset = -(this.top - first) * this.height;
    this.rows.forEach((element, place) => {
      const index = first + place;
      const isShown = place < count && index < this.total;
      element.hidden = !isShown;
      if (!isShown) return;
      element.style.transform = `translateY(${offset + place * this.height}px)`;
      this.paint(element, index);
    });
    this.ask(first, count);
  }

  private element1(): HTMLElement {
    const cells = this.options.columns.map((column, place) =>
      h("span", { class: `cell ${column.name}`, role: "gridcell", "aria-colindex": place + 1 }),
    );
    const row = h("div", { class: "row", role: "row" }, cells);
    row.addEventListener("click", () => this.select(Number(row.dataset.index), true));
    row.addEventListener("dblclick", () => {
      const found = this.row(Number(row.dataset.index));
      if (found) this.options.onOpen(found, Number(row.dataset.index));
    });
    this.layer.append(row);
    return row;
  }

  private paint(element: HTMLElement, index: number): void {
    const row = this.row(index);
    const isSelected = index === this.selected;
    const key = `${this.epoch}:${this.version}:${index}:${row ? 1 : 0}:${isSelected ? 1 : 0}`;
    if (element.dataset.key === key) return;
    element.dataset.key = key;
    element.dataset.index = String(index);
    element.id = isSelected ? `selected-${this.options.label.replace(/\W+/g, "-")}` : "";
    if (!element.id) element.removeAttribute("id");
    else this.scroller.setAttribute("aria-activedescendant", element.id);
    element.setAttribute("aria-rowindex", String(index + 1));
    element.setAttribute("aria-selected", String(isSelected));
    element.className = `row ${row ? this.options.rowClass(row) : "waiting"}${isSelected ? " selected" : ""}`;
    this.options.columns.forEach((column, place) => {
      const cell = element.children[place] as HTMLElement;
      const text = row ? column.cell(row) : "";
      if (cell.textContent !== text) cell.textContent = text;
      if (column.name === "what") cell.title = text;
    });
  }

  /** Requests the pages in view; those that scrolled out meanwhile are not asked for. */
  private ask(first: number, count: number): void {
    if (this.asked.size > 0) return;
    for (let page = Math.floor(first / PAGE); page * PAGE < first + count; page += 1) {
      if (this.pages.has(page) || page * PAGE >= this.total) continue;
      const epoch = this.epoch;
      this.asked.add(page);
      this.options
        .fetch(page * PAGE, PAGE)
        .then((rows) => {
          if (epoch !== this.epoch) return;
          this.pages.set(page, rows);
          while (this.pages.size > MOST_PAGES) {
            const oldest = this.pages.keys().next().value;
            if (oldest === undefined) break;
            this.pages.delete(oldest);
          }
          if (Math.floor(this.pendingTell / PAGE) === page) {
            const row = this.row(this.pendingTell);
            if (row && this.pendingTell === this.selected) this.options.onSelect(row, this.selected);
            this.settle();
          }
        })
        .catch(() => this.settle())
        .finally(() => {
          if (epoch !== this.epoch) return;
          this.asked.delete(page);
          this.plan();
        });
      return;
    }
  }
}
