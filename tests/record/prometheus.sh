#!/usr/bin/env bash
# Metrics scraped by a real Prometheus (Debian's package, unpacked, not installed) for a minute: the target is up, the
# histograms of the stages have numbers, and an alert of docs/operate/metrics/alerts.yml fires when the daemon
# ends. Where the package cannot be had, says so and leaves with 0. FORETRACE is the program (default: built here);
# PROMETHEUS_FOLDER is where the package is unpacked, or is to be.
source "$(dirname "$0")/head.sh"
root=$PWD
folder=$(realpath -m "${PROMETHEUS_FOLDER:-$scratch/prometheus}")
if [[ ! -x $folder/usr/bin/prometheus ]]; then
  mkdir -p "$folder"
  if ! (cd "$scratch" && apt-get download prometheus && dpkg -x prometheus_*.deb "$folder") >"$scratch/log" 2>&1; then
    skip "Debian's package cannot be had here: $(tail -1 "$scratch/log")"
  fi
fi

"$folder/usr/bin/promtool" check rules docs/operate/metrics/alerts.yml
program
start_daemon 43 --no-rights
start_arm
"$FORETRACE" metrics --listen 127.0.0.1:0 "${at[@]}" 2>"$scratch/metrics.log" &
children+=($!)
try "no metrics" grep -q /metrics "$scratch/metrics.log"
target=$(sed -n 's|.*http://\([^/]*\)/metrics.*|\1|p' "$scratch/metrics.log")
curl -s "http://$target/metrics" | "$folder/usr/bin/promtool" check metrics
cat >"$scratch/prometheus.yml" <<END
global: { scrape_interval: 2s, evaluation_interval: 2s }
rule_files: [ "$root/docs/operate/metrics/alerts.yml" ]
scrape_configs: [ { job_name: foretrace, static_configs: [ { targets: [ "$target" ] } ] } ]
END
port=$((20000 + RANDOM % 20000))
"$folder/usr/bin/prometheus" --config.file="$scratch/prometheus.yml" --storage.tsdb.path="$scratch/data" \
  --web.listen-address="127.0.0.1:$port" --log.level=error >"$scratch/prometheus.log" 2>&1 &
children+=($!)
sleep "${SECONDS_TO_SCRAPE:-60}"
python3 - "$port" "$daemon" <<'END'
import json, os, signal, sys, time, urllib.parse, urllib.request

port, daemon = sys.argv[1:]
broken = 0


def judge(right, words):
    global broken
    print(f"{'ok ' if right else 'WRONG'} {words}")
    broken += not right


def ask(path):
    return json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/api/v1/{path}"))["data"]


def value(query):
    found = ask("query?" + urllib.parse.urlencode({"query": query}))["result"]
    return float(found[0]["value"][1]) if found else float("nan")


def firing():
    return {alert["labels"]["alertname"] for alert in ask("alerts")["alerts"] if alert["state"] == "firing"}


judge(value("min_over_time(up[1m])") == 1 and value("foretrace_up") == 1, "the target and the daemon were up for the last minute")
counted = value('increase(foretrace_stage_duration_seconds_count{stage="step"}[40s])')
lost = value("increase(foretrace_metrics_ticks_lost_total[40s])")
rate = value("avg_over_time(foretrace_rate_hertz[40s])")
judge(0.9 * rate < (counted + lost) / 40 < 1.1 * rate,
      f"{counted:.0f} ticks in the histograms and {lost:.0f} lost in 40 s; the status says {rate:.0f} per second")
p99 = value('histogram_quantile(0.99, sum by (le) (rate(foretrace_stage_duration_seconds_bucket{stage="step"}[40s])))')
judge(0 < p99 < 0.1, f"work of a tick: p99 {1e6 * p99:.0f} µs")
judge("ForetraceDown" not in firing(), f"with a daemon: {firing() or 'no alert'}")
os.kill(int(daemon), signal.SIGINT)
deadline = time.monotonic() + 30
while "ForetraceDown" not in firing() and time.monotonic() < deadline:
    time.sleep(0.5)
judge("ForetraceDown" in firing(), f"without one: {firing()}")
sys.exit(broken > 0)
END
