"""The store of campaigns: its files alone determine what has been computed.

STORE/CAMPAIGN_ID/campaign.toml   the spec
                  plan.json       the plan, immutable
                  manifest.json   the parts as last checked; without it a survey takes longer
                  manifest-000001.json  those of batches 2,000 to 3,999
                  labels-000001.json  owner, tags, note, archived; a new file for each change
                  stopped.json    the end of the table, if the stopping rule ended the campaign
                  parts/part-000123.parquet          the rows of batch 123, written whole or not at all
                        rows-000000-000999.parquet   the rows of batches 0 to 999, merged from their parts
                  repeats-1/  such files for the repeats that the plan asks for; their manifest is repeats-1.json
                  repeats.json    shares of further repeats, which are in repeats-2/ and so on
                  report/         the report
                  comparisons/    one report per campaign that it was compared with
                  pooled/         one report per set of campaigns that were pooled with this one
"""

from campaign.store.parts import BadPart, Part, part_name
from campaign.store.store import Store, open_store, read_repeats
from campaign.store.survey import Survey

__all__ = ["BadPart", "Part", "Store", "Survey", "open_store", "part_name", "read_repeats"]
