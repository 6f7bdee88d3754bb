#!/usr/bin/env bash
# Makes an image of Prometheus from Debian's package, where the registry that has its own can't be reached. Needs apt and a Docker engine.
#
#   deploy/prometheus/image.sh                 the image `cyclorama-prometheus`, which takes the same place in compose.yaml:
#   PROMETHEUS_IMAGE=cyclorama-prometheus docker compose -f deploy/compose.yaml --profile metrics up -d prometheus
#
#   deploy/prometheus/image.sh --tag NAME      of another name
set -euo pipefail

tag=cyclorama-prometheus
while [ $# -gt 0 ]; do
    case $1 in
    --tag) tag=$2 ;;
    *) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
    esac
    shift 2
done
. "$(dirname "$0")/../libraries.sh"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
# Only its programs are wanted: unpacked, not installed, so that nothing here starts or stays.
apt-get download -q prometheus >&2 || { apt-get update -q && apt-get download -q prometheus; } >&2
dpkg-deb -x prometheus_*.deb package
mkdir -p root/bin home/prometheus
for program in prometheus promtool; do
    mv "package/usr/bin/$program" root/bin/
    with_libraries "root/bin/$program" root
done
rm -r package prometheus_*.deb
# As in Prometheus' own image: the same paths, arguments and kind of user.
cat >Dockerfile <<'END'
FROM scratch
COPY root/ /
COPY --chown=65534:65534 home/ /
USER 65534:65534
EXPOSE 9090/tcp
WORKDIR /prometheus
ENTRYPOINT ["/bin/prometheus"]
CMD ["--config.file=/etc/prometheus/prometheus.yml", "--storage.tsdb.path=/prometheus"]
END
docker build --quiet --tag "$tag" . >/dev/null
docker image inspect --format '{{index .RepoTags 0}}: {{.Size}} bytes' "$tag"
