// A table of rows that all fit: sortable by its headings.

import { fill, h } from "./dom";

export interface TableColumn<T> {
  title: string;
  name?: string;
  cell(row: T): (Node | string | null | undefined)[] | Node | string | null | undefined;
  order?(row: T): number | string;
}

export class Table<T> {
  readonly element: HTMLElement;
  private body = h("tbody");
  private heads: HTMLElement[] = [];
  private rows: T[] = [];
  private sorted: { column: number; down: boolean } | null = null;

  constructor(
    private options: {
      label: string;
      columns: TableColumn<T>[];
      rowClass?(row: T): string;
      onOpen?(row: T): void;
      empty: string;
    },
  ) {
    this.heads = options.columns.map((column, place) => {
      const order = column.order;
      const head = h("th", { scope: "col", class: column.name ?? "" });
      head.append(order ? h("button", { type: "button", class: "sort", onclick: () => this.sort(place) }, column.title) : column.title);
      return head;
    });
    const table = h("table", { "aria-label": options.label }, h("thead", {}, h("tr", {}, this.heads)), this.body);
    this.element = h("div", { class: "scroll", role: "region", "aria-label": options.label, tabindex: 0 }, table);
  }

  private sort(column: number): void {
    const down = this.sorted?.column === column ? !this.sorted.down : false;
    this.sorted = this.sorted?.column === column && this.sorted.down ? null : { column, down };
    this.heads.forEach((head, place) => {
      const order = this.sorted?.column === place ? (this.sorted.down ? "descending" : "ascending") : null;
      if (order) head.setAttribute("aria-sort", order);
      else head.removeAttribute("aria-sort");
    });
    this.set(this.rows);
  }

  set(rows: T[]): void {
    this.rows = rows;
    const { columns, rowClass, onOpen, empty } = this.options;
    let shown = rows;
    const order = this.sorted && columns[this.sorted.column]?.order;
    if (this.sorted && order) {
      const sign = this.sorted.down ? -1 : 1;
      shown = [...rows].sort((one, other) => {
        const [a, b] = [order(one), order(other)];
        return sign * (a < b ? -1 : a > b ? 1 : 0);
      });
    }
    if (shown.length === 0) {
      fill(this.body, h("tr", {}, h("td", { colspan: columns.length, class: "quiet" }, empty)));
      return;
    }
    const cells = (row: T) =>
      columns.map((column) => {
        const content = column.cell(row);
        const list = Array.isArray(content) ? content : [content];
        return h("td", { class: column.name ?? "" }, list);
      });
    const line = (row: T) => {
      const element = h("tr", { class: rowClass?.(row) ?? "" }, cells(row));
      if (onOpen) {
        element.tabIndex = 0;
        element.addEventListener("click", (event) => {
          if (!(event.target as Element).closest("button, select, input, a")) onOpen(row);
        });
        element.addEventListener("keydown", (event) => {
          if (event.key === "Enter" && event.target === element) onOpen(row);
          const next = event.key === "ArrowDown" || event.key === "j" ? element.nextElementSibling
            : event.key === "ArrowUp" || event.key === "k" ? element.previousElementSibling : null;
          if (next instanceof HTMLElement) {
            event.preventDefault();
            event.stopPropagation();
            next.focus();
          }
        });
      }
      return element;
    };
    fill(this.body, shown.map(line));
  }

  focus(): void {
    const row = this.body.querySelector<HTMLElement>("tr[tabindex]");
    (row ?? this.element).focus({ preventScroll: true });
  }
}
