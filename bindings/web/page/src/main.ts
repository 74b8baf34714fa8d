import "uplot/dist/uPlot.min.css";
import "../../../../decoder/src/report/html/style.css";
import "./page.css";

import { Page } from "./app";

const root = document.getElementById("app");
if (root) new Page(root);
